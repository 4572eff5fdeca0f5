"""3MF: the build of a ZIP archive of XML models, in metres.

Caps, before anything is unpacked or built: the unpacked size, its ratio to the packed one, the
number of parts; a document type is refused (entities could grow without end, or name files);
triangles and instances of nested components are counted before they are made. Only entries of the
archive are read.
"""

from __future__ import annotations

import io
import posixpath
import zipfile
import zlib
from collections.abc import Iterator
from urllib.parse import unquote
from xml.parsers import expat

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.model_xml import (
    Model,
    ModelError,
    ModelObject,
    Reference,
    parse_model,
)
from gpis_grasp_planner.geometry.formats.parsed_mesh import (
    Array,
    Index,
    ParsedMesh,
    check_face_count,
    named_pieces,
    truncated,
)
from gpis_grasp_planner.geometry.formats.recognise import refuse_foreign
from gpis_grasp_planner.geometry.formats.slicer_volumes import CONFIGS, Helpers

METRES = {
    "micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048,
    "meter": 1.0,
}  # fmt: skip
_MOST_BYTES = 1_000_000_000
_MOST_RATIO = 300
_SMALL_BYTES = 10_000_000  # of any ratio
_MOST_ENTRIES = 10_000
_MOST_INSTANCES = 20_000
_MOST_DEPTH = 32


def read_3mf(data: bytes, name: str, max_faces: int) -> ParsedMesh:
    """Read the build of a 3MF file, with the transforms of items and components."""
    if not data.startswith(b"PK"):
        refuse_foreign(data, name, "3MF")
    try:
        return _Package(data, name, max_faces).parsed()
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise truncated(name, f"it is no whole ZIP archive ({type(error).__name__})") from None
    except ModelError as error:
        # Once more from the same program would be the same.
        unread = error.code == ErrorCode.MESH_FORMAT_NOT_SUPPORTED
        cure = "Export the finished shape, such as STL." if unread else "Export it again."
        raise MeshError(f"{name}: {error}. {cure}", error.code) from None


class _Package:
    def __init__(self, data: bytes, name: str, max_faces: int):
        self._archive = zipfile.ZipFile(io.BytesIO(data))
        names = self._archive.namelist()
        self._names = frozenset(names)
        self._in_lower_case = {_lower(name): name for name in reversed(names)}
        self._name = name
        self._max_faces = max_faces
        self._components = 0
        self._left_out = 0
        self._models: dict[str, Model] = {}
        self._check_sizes(len(data))

    def _check_sizes(self, packed: int) -> None:
        entries = self._archive.infolist()
        if any(e.flag_bits & 1 for e in entries):
            raise ModelError("it is encrypted", ErrorCode.MESH_FORMAT_NOT_SUPPORTED)
        total = sum(e.file_size for e in entries)
        limit = max(_SMALL_BYTES, min(_MOST_BYTES, _MOST_RATIO * packed))
        if total > limit or len(entries) > _MOST_ENTRIES:
            raise MeshError(
                f"{self._name} unpacks from {packed} to {total} bytes in {len(entries)} entries, "
                f"the limit is {limit} bytes and {_MOST_ENTRIES} entries. Export it again.",
                ErrorCode.MESH_TOO_LARGE,
            )
        self._left = limit

    def _entry(self, path: str) -> str:
        """The entry of a part; names of parts are the same in any case, and may be escaped."""
        for wanted in (path.lstrip("/"), unquote(path).lstrip("/")):
            if wanted in self._names:
                return wanted
            if _lower(wanted) in self._in_lower_case:
                return self._in_lower_case[_lower(wanted)]
        return path

    def _read(self, path: str) -> bytes:
        try:
            with self._archive.open(self._entry(path)) as entry:
                content = entry.read(self._left + 1)
        except KeyError:
            raise ModelError(f"its part {path[:80]!r} is missing in the archive") from None
        self._left -= len(content)
        if self._left < 0:  # the archive's directory has lied
            raise ModelError("it unpacks to more than its directory says", ErrorCode.MESH_TOO_LARGE)
        return content

    def _start(self) -> str:
        """The path of the main model: by the relationship that names it, else the only one."""
        if self._entry("_rels/.rels") in self._names:
            for kind, target in _relationships(self._read("_rels/.rels")):
                if kind.endswith("/3dmodel"):
                    return posixpath.normpath(posixpath.join("/", target.lstrip("/")))
        models = [n for n in self._archive.namelist() if n.lower().endswith(".model")]
        if len(models) != 1:
            raise ModelError(f"it names no main model ({len(models)} models in the archive)")
        return "/" + models[0]

    def _model(self, path: str) -> Model:
        if path not in self._models:
            model = parse_model(self._read(path), self._max_faces)
            if model.unit not in METRES:
                raise ModelError(f"its unit is {model.unit[:20]!r}; known are {', '.join(METRES)}")
            first = next(iter(self._models.values()), model)
            if model.unit != first.unit:
                units = ", ".join(sorted((first.unit, model.unit)))
                raise ModelError(f"its models are in different units ({units})")
            self._models[path] = model
        return self._models[path]

    def _helpers(self) -> Helpers:
        """What the slicer that wrote the file says of volumes that are no part of the shape."""
        found = Helpers()
        for path in CONFIGS:
            entry = self._entry(path)
            if entry in self._names:
                found.add(self._read(entry))
        return found

    def parsed(self) -> ParsedMesh:
        start = self._start()
        main = self._model(start)
        self._drop(self._helpers(), main)
        notes: list[str] = []
        items = [i for i in main.items if i.printable] or main.items
        if len(items) < len(main.items):
            left_out = len(main.items) - len(items)
            notes.append(f"{left_out} items that are marked as not to be built were left out.")
        if not items:
            items = _unused(main)
            notes.append("Its build is empty; all objects are read instead.")
        vertices: list[Array] = []
        faces: list[Index] = []
        names: list[tuple[str, int]] = []
        n_vertices = n_faces = instances = 0
        most_vertices = max(3 * self._max_faces, _MOST_INSTANCES)
        for item in items:
            where = self._path(item.path, start)
            names.append((self._object(where, item.object_id).name, n_faces))
            for mesh, T in self._instances(where, item.object_id, item.T, 0):
                instances += 1
                n_faces += len(mesh.faces)
                if instances > _MOST_INSTANCES:
                    raise ModelError(
                        f"it has more than {_MOST_INSTANCES} instances of objects",
                        ErrorCode.MESH_TOO_LARGE,
                    )
                check_face_count(max(n_faces, 1), self._name, self._max_faces)
                if n_vertices + len(mesh.vertices) > most_vertices:
                    raise ModelError(
                        f"its instances have more than {most_vertices} vertices",
                        ErrorCode.MESH_TOO_LARGE,
                    )
                mirrored = np.linalg.det(T[:3, :3]) < 0.0
                vertices.append(mesh.vertices @ T[:3, :3].T + T[:3, 3])
                faces.append((mesh.faces[:, ::-1] if mirrored else mesh.faces) + n_vertices)
                n_vertices += len(mesh.vertices)
        check_face_count(n_faces, self._name, self._max_faces)
        if self._left_out:
            notes.append(
                f"{self._left_out} volumes that only guide the slicer (modifiers, blockers, other "
                "objects) were left out."
            )
        return ParsedMesh(
            METRES[main.unit] * np.concatenate(vertices),
            np.concatenate(faces),
            own_unit=main.unit,
            notes=tuple(notes),
            pieces=named_pieces(names, n_faces),
        )

    def _drop(self, helpers: Helpers, main: Model) -> None:
        for object_id, parts in helpers.parts.items():
            if object_id in main.objects:
                holder = main.objects[object_id]
                kept = [c for c in holder.components if c.object_id not in parts]
                self._left_out += len(holder.components) - len(kept)
                holder.components = kept
        for object_id, ranges in helpers.faces.items():
            if object_id in main.objects:
                holder = main.objects[object_id]
                gone = np.zeros(len(holder.faces), dtype=bool)
                for first, last in ranges:
                    gone[first : last + 1] = True
                self._left_out += len(ranges)
                holder.faces = holder.faces[~gone]

    @staticmethod
    def _path(path: str, here: str) -> str:
        return posixpath.normpath(posixpath.join("/", path)) if path else here

    def _object(self, where: str, object_id: str) -> ModelObject:
        found = self._model(where).objects.get(object_id)
        if found is None:
            raise ModelError(f"object {object_id[:20]!r} is missing")
        return found

    def _instances(
        self, where: str, object_id: str, T: Array, depth: int
    ) -> Iterator[tuple[ModelObject, Array]]:
        """Meshes of an object and its components; a component that holds itself is too deep."""
        if depth > _MOST_DEPTH:
            raise ModelError(f"its components are nested deeper than {_MOST_DEPTH}")
        found = self._object(where, object_id)
        if found.kind in ("support", "solidsupport"):
            return
        if found.kind == "other" and depth:
            self._left_out += 1
            return
        if len(found.faces):
            yield found, T
        self._components += len(found.components)
        if self._components > _MOST_INSTANCES:
            raise ModelError(
                f"it has more than {_MOST_INSTANCES} components", ErrorCode.MESH_TOO_LARGE
            )
        for part in found.components:
            yield from self._instances(
                self._path(part.path, where), part.object_id, T @ part.T, depth + 1
            )


def _unused(model: Model) -> list[Reference]:
    used = {c.object_id for o in model.objects.values() for c in o.components}
    return [Reference(i, np.eye(4), "") for i in model.objects if i not in used]


def _lower(name: str) -> str:
    return name.replace("\\", "/").lstrip("/").lower()


def _relationships(xml: bytes) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag.rpartition("}")[2].rpartition(":")[2] == "Relationship":
            found.append((attributes.get("Type", ""), attributes.get("Target", "")))

    parser = expat.ParserCreate()
    parser.StartElementHandler = start
    try:
        parser.Parse(xml, True)
    except expat.ExpatError:
        raise ModelError("its relationships are not valid XML") from None
    return found

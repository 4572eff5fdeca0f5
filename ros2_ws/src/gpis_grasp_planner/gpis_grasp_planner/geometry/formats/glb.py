"""GLB, the binary form of glTF 2.0: triangles of the nodes of its scene, in metres.

Nothing outside of the file is ever opened. Every accessor must lie within the file, so that
what is unpacked is bounded by what was read; instances are counted before they are made.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.accessors import AccessorError, Accessors
from gpis_grasp_planner.geometry.formats.parsed_mesh import (
    Array,
    Index,
    ParsedMesh,
    check_face_count,
    named_pieces,
    truncated,
)
from gpis_grasp_planner.geometry.formats.recognise import refuse_foreign

_MOST_NODES = 100_000
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
# Extensions a file may require without another shape coming of it.
_HARMLESS = ("KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "EXT_texture_",
             "MSFT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp", "KHR_animation_pointer",
             "EXT_structural_metadata", "EXT_mesh_features", "TM_brep_faces")  # fmt: skip
_COMPRESSED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
_INSTANCES = "EXT_mesh_gpu_instancing"
_SHAPELESS = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError)


@dataclass(frozen=True, eq=False)
class GlbBody:
    """A mesh of a node: its name, and one (vertices (n, 3) [m], faces (m, 3)) a primitive.

    `source` is the same for nodes that place the same mesh.
    """

    name: str
    primitives: list[tuple[Array, Index]]
    source: int = 0


def read_glb(data: bytes, name: str, max_faces: int) -> ParsedMesh:
    """Read a GLB file; glTF prescribes metres, and y as the axis that points up."""
    if data[:4] != b"glTF":
        refuse_foreign(data, name, "GLB")
    bodies, notes = glb_bodies(data, name, max_faces)
    notes.append("In GLB lengths are metres and y points up; the part's frame is the file's.")
    return joined(bodies, tuple(notes))


def joined(bodies: list[GlbBody], notes: tuple[str, ...], doubt: str | None = None) -> ParsedMesh:
    """One mesh of bodies in metres, each a piece of it."""
    names: list[tuple[str, int]] = []
    vertices: list[Array] = []
    faces: list[Index] = []
    n_vertices = n_faces = 0
    for body in bodies:
        names.append((body.name, n_faces))
        for points, triangles in body.primitives:
            vertices.append(points)
            faces.append(triangles + n_vertices)
            n_vertices += len(points)
            n_faces += len(triangles)
    return ParsedMesh(
        np.concatenate(vertices),
        np.concatenate(faces),
        own_unit="m",
        notes=notes,
        doubt=doubt,
        pieces=named_pieces(names, n_faces),
    )


def glb_bodies(data: bytes, name: str, max_faces: int) -> tuple[list[GlbBody], list[str]]:
    """The bodies of the scene of a GLB file with their transforms applied, and notes."""
    document, binary = _chunks(data, name)
    _check_extensions(document, name)
    try:
        return _Scene(document, binary, name, max_faces).bodies()
    except AccessorError as error:
        raise MeshError(f"{name}: {error}. Export it again as self-contained GLB.") from None
    except _SHAPELESS as error:
        raise truncated(
            name, f"its scene is not that of a GLB file ({type(error).__name__})"
        ) from None


def _chunks(data: bytes, name: str) -> tuple[dict[str, Any], bytes]:
    if len(data) < 20 or data[:4] != b"glTF":
        raise truncated(name, "it does not start with 'glTF'")
    version, length = struct.unpack_from("<2I", data, 4)
    if version != 2:
        raise MeshError(
            f"{name} is glTF {version}; only version 2 is read. Export it again.",
            ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
        )
    if length > len(data):
        raise truncated(name, f"its header promises {length} bytes, the file has {len(data)}")
    chunks: list[tuple[int, bytes]] = []
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<2I", data, at)
        if at + 8 + size > length:
            raise truncated(name, f"a chunk of {size} bytes does not fit into {length}")
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    if not chunks or chunks[0][0] != 0x4E4F534A:
        raise truncated(name, "its first chunk is not JSON")
    try:
        # Some writers fill the chunk with zero bytes in place of blanks.
        document = json.loads(chunks[0][1].rstrip(b"\0").decode("utf-8-sig"))
    except (ValueError, RecursionError):
        raise truncated(name, "its JSON chunk is not valid") from None
    if not isinstance(document, dict):
        raise truncated(name, "its JSON chunk is no object")
    return document, next((body for kind, body in chunks[1:] if kind == 0x004E4942), b"")


def _check_extensions(document: dict[str, Any], name: str) -> None:
    required = document.get("extensionsRequired", [])
    for extension in required if isinstance(required, list) else []:
        if extension in _COMPRESSED:
            raise MeshError(
                f"{name} is compressed with {_COMPRESSED[extension]}, which is not read. Export it "
                "without compression.",
                ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
            )
        if not str(extension).startswith(_HARMLESS):
            raise MeshError(
                f"{name} requires the glTF extension {str(extension)[:60]!r}, which is not read. "
                "Export plain GLB.",
                ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
            )


class _Scene:
    def __init__(self, document: dict[str, Any], binary: bytes, name: str, max_faces: int):
        self._document = document
        self._accessors = Accessors(document, binary)
        self._name = name
        self._max_faces = max_faces
        self._meshes: dict[int, list[tuple[Array, Index]]] = {}
        self._notes: dict[str, None] = {}

    def bodies(self) -> tuple[list[GlbBody], list[str]]:
        """Walk the scene from its roots; a node that is met twice is an error (a loop)."""
        nodes: list[dict[str, Any]] = self._document.get("nodes", [])
        stack = [(i, np.eye(4)) for i in reversed(self._roots(nodes))]
        met: set[int] = set()
        bodies: list[GlbBody] = []
        faces = 0
        while stack:
            i, above = stack.pop()
            if i in met or len(met) >= _MOST_NODES or not 0 <= i < len(nodes):
                raise truncated(self._name, f"its node {i} is missing or is met twice")
            met.add(i)
            node = nodes[i]
            T = above @ _local(node)
            stack += [(int(c), T) for c in reversed(node.get("children", []))]
            if "mesh" not in node:
                continue
            if _INSTANCES in node.get("extensions", {}):
                raise MeshError(
                    f"{self._name} places a mesh many times by the glTF extension '{_INSTANCES}', "
                    "which is not read. Export plain GLB, each copy as a node.",
                    ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
                )
            if "skin" in node:
                self._notes["A skin was ignored: the shape is that of its mesh, unposed."] = None
                T = np.eye(4)  # a skinned mesh is not moved by its own node
            self._refuse_morphed(node)
            primitives = self._mesh(int(node["mesh"]))
            faces += sum(len(f) for _, f in primitives)
            if faces > self._max_faces:
                check_face_count(faces, self._name, self._max_faces)
            mesh_name = self._document["meshes"][int(node["mesh"])].get("name", "")
            title = str(node.get("name") or mesh_name)
            bodies.append(GlbBody(title, _moved(primitives, T), int(node["mesh"])))
        if faces == 0:
            check_face_count(0, self._name, self._max_faces)
        return bodies, list(self._notes)

    def _roots(self, nodes: list[dict[str, Any]]) -> list[int]:
        scenes = self._document.get("scenes", [])
        if scenes:
            chosen = int(self._document.get("scene", 0))
            if len(scenes) > 1:
                self._notes[f"Of {len(scenes)} scenes the default one is read."] = None
            return [int(i) for i in scenes[chosen].get("nodes", [])]
        children = {int(c) for n in nodes for c in n.get("children", [])}
        return [i for i in range(len(nodes)) if i not in children]

    def _mesh(self, index: int) -> list[tuple[Array, Index]]:
        if index not in self._meshes:
            if index < 0:
                raise IndexError
            mesh = self._document["meshes"][index]
            read: list[tuple[Array, Index]] = []
            faces = 0
            for primitive in mesh["primitives"]:
                found = self._primitive(primitive)
                if found is None or not len(found[1]):
                    continue
                faces += len(found[1])
                check_face_count(faces, self._name, self._max_faces)
                read.append(_used(*found))
            self._meshes[index] = read
        return self._meshes[index]

    def _refuse_morphed(self, node: dict[str, Any]) -> None:
        mesh = self._document["meshes"][int(node["mesh"])]
        weights = node.get("weights", mesh.get("weights", []))
        if any(float(w) != 0.0 for w in weights):
            raise MeshError(
                f"{self._name} is morphed: its targets have the weights {str(weights)[:60]}, which "
                "are not read. Apply the shape keys and export it again.",
                ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
            )

    def _primitive(self, primitive: dict[str, Any]) -> tuple[Array, Index] | None:
        mode = int(primitive.get("mode", _TRIANGLES))
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            self._notes["Points and lines were ignored."] = None
            return None
        if primitive.get("targets"):
            self._notes["Morph targets were ignored: the shape is that at rest."] = None
        points = self._accessors.positions(int(primitive["attributes"]["POSITION"]))
        if "indices" in primitive:
            corners = self._accessors.indices(int(primitive["indices"]))
        else:
            corners = np.arange(len(points))
        if corners.size and int(corners.max()) >= len(points):
            raise MeshError(
                f"{self._name}: a face uses vertex index {int(corners.max())}, its mesh has "
                f"{len(points)} vertices. Export it again.",
                ErrorCode.MESH_BAD_INDEX,
            )
        if mode == _TRIANGLES:
            if len(corners) % 3:
                raise truncated(self._name, f"{len(corners)} indices are no whole triangles")
            return points, corners.reshape(-1, 3)
        n = np.arange(max(len(corners) - 2, 0))
        if mode == _FAN:
            return points, np.stack([corners[n + 1], corners[n + 2], corners[0 * n]], axis=1)
        odd = n % 2
        return points, np.stack([corners[n], corners[n + 1 + odd], corners[n + 2 - odd]], axis=1)


def _used(points: Array, faces: Index) -> tuple[Array, Index]:
    """Without the points of other primitives, with which exporters share one accessor."""
    if 3 * len(faces) >= len(points):
        return points, faces
    kept, index = np.unique(faces, return_inverse=True)
    return points[kept], index.reshape(faces.shape)


def _moved(primitives: list[tuple[Array, Index]], T: Array) -> list[tuple[Array, Index]]:
    mirrored = np.linalg.det(T[:3, :3]) < 0.0
    with np.errstate(invalid="ignore", over="ignore"):  # the judge of meshes refuses what comes out
        return [
            (points @ T[:3, :3].T + T[:3, 3], faces[:, ::-1] if mirrored else faces)
            for points, faces in primitives
        ]


def _local(node: dict[str, Any]) -> NDArray[np.float64]:
    """The node's transform `T_parent_node`; its matrix is stored column by column."""
    T = np.eye(4)
    if "matrix" in node:
        T = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    else:
        x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
        length = x * x + y * y + z * z + w * w
        if not length > 0.0:
            raise ValueError("a rotation of length 0")
        s = 2.0 / length
        T[:3, :3] = [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
        T[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64).reshape(3)
        T[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64).reshape(3)
    if not np.isfinite(T).all():
        raise ValueError("a transform that is not finite")
    return T

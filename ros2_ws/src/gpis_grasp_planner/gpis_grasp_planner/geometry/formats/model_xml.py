"""The XML of a 3MF model: objects with meshes or components, and the items of the build."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_BEFORE_1_0 = "http://schemas.microsoft.com/3dmanufacturing/2013/01"  # the same shapes
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
# Extensions that a model may require without another shape coming of it.
_HARMLESS = {
    _CORE,
    _PRODUCTION,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
}


# Elements of extensions that change the shape, also where a file does not require them.
_OTHER_SHAPES = {
    "beamlattice": "a lattice of beams",
    "booleanshape": "a boolean operation on shapes",
    "displacementmesh": "a displaced mesh",
    "levelset": "an implicit shape",
}


class ModelError(Exception):
    """What is wrong with a model, as a part of a sentence."""

    def __init__(self, message: str, code: ErrorCode = ErrorCode.MESH_UNREADABLE):
        super().__init__(message)
        self.code = code


@dataclass(frozen=True, eq=False)
class Reference:
    """An item of the build or a component: an object, moved by `T` (4, 4) from the left."""

    object_id: str
    T: Array
    path: str
    printable: bool = True


@dataclass(eq=False)
class ModelObject:
    """An object: its own triangles, or others as components."""

    name: str
    kind: str
    vertices: Array = field(default_factory=lambda: np.zeros((0, 3)))
    faces: Index = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    components: list[Reference] = field(default_factory=list)


@dataclass(eq=False)
class Model:
    """A model: objects by ID, and what is to be built."""

    unit: str = "millimeter"
    objects: dict[str, ModelObject] = field(default_factory=dict)
    items: list[Reference] = field(default_factory=list)


def parse_model(xml: bytes, max_faces: int) -> Model:
    """Parse a model. Raises ModelError; about 2 us for each vertex and triangle."""
    reader = _Reader(max_faces)
    try:
        reader.parser.Parse(xml, True)
    except expat.ExpatError as error:
        raise ModelError(
            f"its model is not valid XML (line {error.lineno}: {expat.ErrorString(error.code)})"
        ) from None
    except (KeyError, ValueError) as error:
        line = reader.parser.CurrentLineNumber
        if isinstance(error, ValueError) and "," in str(error):
            raise ModelError(
                f"a number in line {line} has a decimal comma ({str(error)[-20:]})"
            ) from None
        raise ModelError(f"its model is damaged in line {line} ({str(error)[:40]})") from None
    return reader.model


def transform(text: str | None) -> Array:
    """Twelve numbers, a matrix for rows of points on its left, as `T` (4, 4) from the left."""
    T = np.eye(4)
    if text:
        numbers = np.array(text.split(), dtype=np.float64)
        if numbers.shape != (12,) or not np.isfinite(numbers).all():
            raise ValueError("transform")
        T[:3] = numbers.reshape(4, 3).T
    return T


class _Reader:
    def __init__(self, max_faces: int):
        self.model = Model()
        self._max_faces = max_faces
        self._object: ModelObject | None = None
        self._vertices = array("d")
        self._faces = array("q")
        self._spaces: dict[str, str] = {}  # of prefixes
        self.parser = expat.ParserCreate(namespace_separator="}")
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartNamespaceDeclHandler = self._name_space
        self.parser.StartDoctypeDeclHandler = self._refuse_doctype

    def _refuse_doctype(self, *_: object) -> None:
        raise ModelError("it has a document type, which 3MF forbids (its entities could be a trap)")

    def _name_space(self, prefix: str | None, uri: str) -> None:
        self._spaces[prefix or ""] = uri

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        space, _, local = tag.rpartition("}")
        if space not in (_CORE, _BEFORE_1_0, ""):
            if local in _OTHER_SHAPES:
                raise ModelError(
                    f"it has {_OTHER_SHAPES[local]}, which is not read",
                    ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
                )
            return
        if local == "vertex":
            a = attributes
            self._vertices.extend((float(a["x"]), float(a["y"]), float(a["z"])))
        elif local == "triangle":
            a = attributes
            self._faces.extend((int(a["v1"]), int(a["v2"]), int(a["v3"])))
            if len(self._faces) > 3 * self._max_faces:
                raise ModelError(
                    f"it has more faces than the limit of {self._max_faces} (catalogue.max_faces)",
                    ErrorCode.MESH_TOO_LARGE,
                )
        elif local == "object":
            self._object = ModelObject(attributes.get("name", ""), attributes.get("type", "model"))
            if attributes["id"] in self.model.objects:
                raise ModelError(f"two of its objects have the ID {attributes['id'][:20]!r}")
            self.model.objects[attributes["id"]] = self._object
        elif local == "component" and self._object is not None:
            self._object.components.append(_reference(attributes))
        elif local == "item":
            self.model.items.append(_reference(attributes))
        elif local == "model":
            self.model.unit = attributes.get("unit", "millimeter")
            required = attributes.get("requiredextensions", "").split()
            unknown = [p for p in required if self._spaces.get(p, p) not in _HARMLESS]
            if unknown:
                raise ModelError(
                    f"it requires the extension {self._extension(unknown[0])!r} of 3MF, which is "
                    "not read",
                    ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
                )

    def _extension(self, prefix: str) -> str:
        """What the address of an extension calls it, such as 'slice'; else its prefix."""
        _, _, named = self._spaces.get(prefix, "").partition("/3dmanufacturing/")
        return (named.split("/")[0] or prefix)[:40]

    def _end(self, tag: str) -> None:
        if tag.rpartition("}")[2] != "mesh" or self._object is None:
            return
        vertices = np.frombuffer(self._vertices, dtype=np.float64).reshape(-1, 3).copy()
        faces = np.frombuffer(self._faces, dtype=np.int64).reshape(-1, 3).copy()
        self._vertices, self._faces = array("d"), array("q")
        wrong = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
        if wrong.size:
            raise ModelError(
                f"face {wrong[0] + 1} of object {self._object.name[:20]!r} uses the vertex indices "
                f"{faces[wrong[0]].tolist()}, it has {len(vertices)} vertices",
                ErrorCode.MESH_BAD_INDEX,
            )
        self._object.vertices, self._object.faces = vertices, faces


def _reference(attributes: dict[str, str]) -> Reference:
    return Reference(
        attributes["objectid"],
        transform(attributes.get("transform")),
        attributes.get(f"{_PRODUCTION}}}path", ""),
        attributes.get("printable", "1") not in ("0", "false"),
    )

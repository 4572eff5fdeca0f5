"""Volumes of a slicer's 3MF project that are no part of the shape: modifiers, blockers, holes.

PrusaSlicer and its kin put all volumes of an object into one mesh and name ranges of faces in a
file of their own; Bambu Studio and OrcaSlicer make each volume a component. To a reader of 3MF
alone they look like any other triangles.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.formats.model_xml import ModelError

CONFIGS = ("Metadata/Slic3r_PE_model.config", "Metadata/model_settings.config")
_SHAPE = ("ModelPart", "normal_part")
_HOLES = ("NegativeVolume", "negative_part")


@dataclass(eq=False)
class Helpers:
    """What is to be left out, by the ID of the object that holds it.

    Attributes
    ----------
    faces : dict of list of (int, int)
        First and last face of each volume.
    parts : dict of set of str
        IDs of the objects that are its components.
    """

    faces: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    parts: dict[str, set[str]] = field(default_factory=dict)

    def add(self, xml: bytes) -> None:
        """Read one of :data:`CONFIGS`. Raises ModelError for a volume that is to be cut away."""
        reader = _Reader(self)
        parser = expat.ParserCreate()
        parser.StartElementHandler = reader.start
        parser.EndElementHandler = reader.end
        parser.StartDoctypeDeclHandler = _refuse_doctype
        try:
            parser.Parse(xml, True)
        except (expat.ExpatError, KeyError, ValueError):
            raise ModelError("what its slicer says of its volumes cannot be read") from None


def _refuse_doctype(*_: object) -> None:
    raise ModelError("it has a document type, which 3MF forbids (its entities could be a trap)")


class _Reader:
    def __init__(self, helpers: Helpers):
        self._helpers = helpers
        self._object = ""
        self._range: tuple[int, int] | None = None
        self._kind = _SHAPE[0]

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if tag == "object":
            self._object = attributes["id"]
        elif tag == "volume":
            self._range = int(attributes["firstid"]), int(attributes["lastid"])
            self._kind = _SHAPE[0]
        elif tag == "part" and self._object:
            self._refuse_hole(attributes.get("subtype", ""))
            if attributes.get("subtype", _SHAPE[1]) not in _SHAPE:
                self._helpers.parts.setdefault(self._object, set()).add(attributes["id"])
        elif tag == "metadata" and self._range is not None:
            key, value = attributes.get("key"), attributes.get("value", "")
            if key == "volume_type":
                self._kind = value
            elif key == "modifier" and value == "1" and self._kind in _SHAPE:
                self._kind = "ParameterModifier"

    def end(self, tag: str) -> None:
        if tag == "volume" and self._range is not None:
            self._refuse_hole(self._kind)
            if self._kind not in _SHAPE:
                first, last = self._range
                if first < 0:
                    raise ValueError("a negative index")
                self._helpers.faces.setdefault(self._object, []).append((first, last))
            self._range = None
        elif tag == "object":
            self._object = ""

    def _refuse_hole(self, kind: str) -> None:
        if kind in _HOLES:
            raise ModelError(
                "it has a negative volume, which a slicer cuts away and this reader does not",
                ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
            )

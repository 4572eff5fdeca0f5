"""Legal oddities of GLB and 3MF files, and traps in them."""

from __future__ import annotations

import json
import struct

import mesh_dialects as d
import numpy as np
from mesh_corpus import TWO, A, B, Read, Refused
from mesh_dialects import BOX, Solid

from gpis_grasp_planner.errors import ErrorCode

_DOCUMENT, _BINARY = d.glb_document(BOX)


def _glb_without_indices() -> bytes:
    points = (d.stl_corners(BOX).reshape(-1, 3) * 1e-3).astype("<f4")
    document = json.loads(json.dumps(_DOCUMENT))
    document["accessors"] = [{"bufferView": 0, "componentType": 5126, "count": 36, "type": "VEC3"}]
    document["bufferViews"] = [{"buffer": 0, "byteLength": points.nbytes}]
    document["buffers"] = [{"byteLength": points.nbytes}]
    document["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0}}]
    return d.glb(document, points.tobytes())


def _glb_changed(**changes) -> bytes:
    return d.glb({**_DOCUMENT, **changes}, _BINARY)


def _glb_padded(padding: bytes) -> bytes:
    """The JSON chunk filled up with something else than blanks."""
    text = json.dumps(_DOCUMENT).encode()
    text += padding * (4 - len(text) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<2I", len(_BINARY), 0x004E4942) + _BINARY
    return b"glTF" + struct.pack("<2I", 2, 12 + len(chunks)) + chunks


def _glb_in_primitives() -> bytes:
    """A primitive a triangle, all with the same positions, as three.js writes groups."""
    first, second = _DOCUMENT["accessors"]
    rows = [{**second, "byteOffset": 6 * k, "count": 3} for k in range(12)]
    primitives = [{"attributes": {"POSITION": 0}, "indices": 1 + k} for k in range(12)]
    return _glb_changed(accessors=[first, *rows], meshes=[{"primitives": primitives}])


_COMPRESSED_AWAY = [{k: v for k, v in a.items() if k != "bufferView"}
                    for a in _DOCUMENT["accessors"]]  # fmt: skip
_STAND_IN = [{**v, "buffer": 1} for v in _DOCUMENT["bufferViews"]]
_TARGETS = {"attributes": {"POSITION": 0}, "indices": 1, "targets": [{"POSITION": 0}]}
_MOVED = {"mesh": 0, "translation": [0.1, 0, 0], "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)]}
GLB = {
    "plain": Read(d.glb(_DOCUMENT, _BINARY), note="y points up"),
    "no indices": Read(_glb_without_indices()),
    "no scene": Read(_glb_changed(scenes=[])),
    "mirrored": Read(_glb_changed(nodes=[{"mesh": 0, "scale": [-1, 1, 1]}]),
                     Solid(BOX.vertices * (-1, 1, 1), [], BOX.volume)),
    "turned": Read(_glb_changed(nodes=[_MOVED]),
                   Solid(BOX.vertices[:, [1, 0, 2]] * (-1, 1, 1) + (100, 0, 0), [], BOX.volume)),
    "matrix in a child": Read(
        _glb_changed(nodes=[{"children": [1], "scale": [2, 2, 2]},
                            {"mesh": 0, "matrix": [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0,
                                                   0.01, 0, 0, 1]}],
                     scenes=[{"nodes": [0]}]), BOX.moved((20, 0, 0))),
    "two instances": Read(d.glb(*d.glb_document(A, nodes=[
        {"mesh": 0, "name": "left"}, {"mesh": 0, "name": "right", "translation": [0.03, 0, 0]}])),
        TWO, note="1 'left', 2 'right'"),
    "harmless extension": Read(_glb_changed(extensionsRequired=["KHR_materials_unlit"])),
    "extensions of pictures and data": Read(_glb_changed(extensionsRequired=[
        "MSFT_texture_dds", "EXT_mesh_features", "KHR_animation_pointer"])),
    "filled up with zero bytes": Read(_glb_padded(b"\0")),
    "primitives that share positions": Read(_glb_in_primitives()),
    "a skin on a node that is scaled": Read(_glb_changed(
        nodes=[{"mesh": 0, "skin": 0, "scale": [2, 2, 2]}]), note="A skin was ignored"),
    "morph targets at rest": Read(_glb_changed(meshes=[{"primitives": [_TARGETS]}]),
                                  note="Morph targets"),
    "morph targets that are not at rest": Refused(_glb_changed(
        meshes=[{"primitives": [_TARGETS], "weights": [0.5]}]), ("morphed", "0.5"),
        ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "instances by an extension": Refused(_glb_changed(nodes=[
        {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}}]),
        ("EXT_mesh_gpu_instancing",), ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "draco that is not required": Refused(_glb_changed(accessors=_COMPRESSED_AWAY), ("no data",)),
    "meshopt that is not required": Refused(_glb_changed(
        bufferViews=_STAND_IN, buffers=[*_DOCUMENT["buffers"], {"byteLength": len(_BINARY)}]),
        ("buffer 1 has no data",)),
    "a rotation of length 0": Refused(_glb_changed(nodes=[
        {"mesh": 0, "rotation": [0, 0, 0, 0]}]), ("its scene is not",)),
    "draco": Refused(_glb_changed(extensionsRequired=["KHR_draco_mesh_compression"]), ("Draco",),
                     ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "another file": Refused(_glb_changed(buffers=[{"uri": "../../etc/passwd", "byteLength": 9}]),
                            ("another file", "not opened")),
    "a loop": Refused(_glb_changed(nodes=[{"mesh": 0, "children": [0]}]), ("met twice",)),
    "beyond the buffer": Refused(_glb_changed(bufferViews=[{"buffer": 0, "byteLength": 10**9}] * 2),
                                 ("does not fit",)),
    "too many entries": Refused(_glb_changed(accessors=[
        {**_DOCUMENT["accessors"][0], "count": 10**9}, _DOCUMENT["accessors"][1]]),
        ("do not fit",)),
}  # fmt: skip

_PART = f'<object id="1" type="model" name="part">{d.mesh_xml(BOX)}</object>'
_A_PART = f'<object id="1" type="model" name="cube">{d.mesh_xml(A)}</object>'
_SHIFT = "1 0 0 0 1 0 0 0 1 30 0 0"
_COMPONENTS = (
    _A_PART + '<object id="2" type="model" name="pair"><components><component objectid="1"/>'
    f'<component objectid="1" transform="{_SHIFT}"/></components></object>'
)
_TOGETHER = Solid(np.vstack([BOX.vertices, B.vertices + 100]),
                  [*BOX.polygons, *([i + 8 for i in p] for p in B.polygons)], 0.0)  # fmt: skip
_TWO_COMPONENTS = (
    _PART
    + '<object id="2" type="{kind}">'
    + d.mesh_xml(B)
    + '</object><object id="3" type="model">'
    '<components><component objectid="1"/><component objectid="2"/></components></object>'
)


def _prusa(kind: str) -> dict[str, str]:
    return {"Metadata/Slic3r_PE_model.config": (
        '<config><object id="1"><volume firstid="0" lastid="11"><metadata type="volume" '
        'key="volume_type" value="ModelPart"/></volume><volume firstid="12" lastid="23"><metadata '
        f'type="volume" key="volume_type" value="{kind}"/></volume></object></config>'
    )}  # fmt: skip


def _bambu(kind: str) -> dict[str, str]:
    return {"Metadata/model_settings.config": (
        '<config><object id="3"><metadata key="name" value="p"/><part id="1" '
        f'subtype="normal_part"/><part id="2" subtype="{kind}"/></object></config>'
    )}  # fmt: skip


def _with_helpers(resources: str, item: int, more: dict[str, str]) -> bytes:
    return d.threemf(d.model_xml(resources, f'<item objectid="{item}"/>'), more)


_ONE_MESH = f'<object id="1" type="model">{d.mesh_xml(_TOGETHER)}</object>'
_BAMBU = _TWO_COMPONENTS.format(kind="model")
_BOMB = "".join(
    f'<object id="{i}"><components>' + f'<component objectid="{i - 1}"/>' * 20
    + "</components></object>" for i in range(2, 12)
)  # fmt: skip
_ENTITIES = '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;">]>'
_FILE_ENTITY = '<!DOCTYPE m [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
THREEMF = {
    "plain": Read(d.simple_3mf(BOX)),
    "no unit": Read(d.simple_3mf(BOX, unit="")),
    "centimetres": Read(d.simple_3mf(Solid(BOX.vertices / 10, BOX.polygons, 0), "centimeter")),
    "inches": Read(d.simple_3mf(Solid(BOX.vertices / 25.4, BOX.polygons, 0), "inch")),
    "metres": Read(d.simple_3mf(Solid(BOX.vertices / 1000, BOX.polygons, 0), "meter")),
    "microns": Read(d.simple_3mf(Solid(BOX.vertices * 1000, BOX.polygons, 0), "micron")),
    "moved": Read(d.simple_3mf(BOX, transform=_SHIFT), BOX.moved((30, 0, 0))),
    "turned": Read(d.simple_3mf(BOX, transform="0 1 0 -1 0 0 0 0 1 0 0 0"),
                   Solid(BOX.vertices[:, [1, 0, 2]] * (-1, 1, 1), [], BOX.volume)),
    "mirrored": Read(d.simple_3mf(BOX, transform="-1 0 0 0 1 0 0 0 1 0 0 0"),
                     Solid(BOX.vertices * (-1, 1, 1), [], BOX.volume)),
    "components": Read(d.threemf(d.model_xml(_COMPONENTS, '<item objectid="2"/>')), TWO),
    "two items": Read(d.threemf(d.model_xml(
        _A_PART, f'<item objectid="1"/><item objectid="1" transform="{_SHIFT}"/>')), TWO,
        note="1 'cube', 2 'cube (2)'"),
    "another model in the archive": Read(d.threemf(
        d.model_xml("", '<item objectid="1" p:path="/3D/Objects/object_1.model"/>'),
        {"3D/Objects/object_1.model": d.model_xml(_PART, "")})),
    "item not to be built": Read(d.threemf(d.model_xml(
        _PART, f'<item objectid="1"/><item objectid="1" printable="0" transform="{_SHIFT}"/>')),
        note="not to be built"),
    "support": Read(d.threemf(d.model_xml(
        _PART + f'<object id="2" type="support">{d.mesh_xml(B)}</object>',
        '<item objectid="1"/><item objectid="2"/>'))),
    "a modifier in the same mesh": Read(_with_helpers(
        _ONE_MESH, 1, _prusa("ParameterModifier")), note="1 volumes that only guide"),
    "a modifier as a component": Read(_with_helpers(_BAMBU, 3, _bambu("modifier_part")),
                                      note="1 volumes that only guide"),
    "a component of another kind": Read(_with_helpers(
        _TWO_COMPONENTS.format(kind="other"), 3, {}), note="1 volumes that only guide"),
    "a negative volume in the same mesh": Refused(_with_helpers(
        _ONE_MESH, 1, _prusa("NegativeVolume")), ("negative volume",),
        ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "a negative volume as a component": Refused(_with_helpers(
        _BAMBU, 3, _bambu("negative_part")), ("negative volume",),
        ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "names in another case": Read(d.threemf(
        d.model_xml("", '<item objectid="1" p:path="/3d/objects/A%20B.model"/>'),
        {"3D/Objects/a b.model": d.model_xml(_PART, "")})),
    "models in different units": Refused(d.threemf(
        d.model_xml("", '<item objectid="1" p:path="/3D/a.model"/>'),
        {"3D/a.model": d.model_xml(_PART, "", unit="inch")}), ("inch, millimeter",)),
    "empty build": Read(d.threemf(d.model_xml(_PART, "")), note="build is empty"),
    "stored, and another path": Read(d.package({"model/a.model": d.model_xml(
        _PART, '<item objectid="1"/>')}, 0)),
    "entities": Refused(d.threemf(d.model_xml(_PART, "", before=_ENTITIES)), ("document type",)),
    "entity of a file": Refused(d.threemf(d.model_xml(_PART, "", before=_FILE_ENTITY)),
                                ("document type",)),
    "components without end": Refused(d.threemf(d.model_xml(
        _A_PART + _BOMB, '<item objectid="11"/>')), ("components",), ErrorCode.MESH_TOO_LARGE),
    "a component of itself": Refused(d.threemf(d.model_xml(
        '<object id="1"><components><component objectid="1"/></components></object>',
        '<item objectid="1"/>')), ("nested",)),
    "zip bomb": Refused(d.threemf(d.model_xml(_PART, '<item objectid="1"/>'),
                                  {"3D/filling": b"\0" * 60_000_000}), ("unpacks",),
                        ErrorCode.MESH_TOO_LARGE),
    "a path out": Refused(d.threemf(d.model_xml(
        "", '<item objectid="1" p:path="../../../etc/passwd"/>')), ("missing in the archive",)),
    "unknown extension": Refused(d.threemf(d.model_xml(
        _PART, '<item objectid="1"/>', more=' xmlns:b="http://b" requiredextensions="b"')),
        ("extension 'b'",), ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "beams beside the triangles": Refused(d.threemf(d.model_xml(
        _PART.replace("</mesh>", "<b:beamlattice/></mesh>"), '<item objectid="1"/>',
        more=' xmlns:b="http://b"')), ("lattice of beams",), ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "two objects of one ID": Refused(d.threemf(d.model_xml(
        _PART + _A_PART, '<item objectid="1"/>')), ("two of its objects",)),
    "bad index": Refused(d.threemf(d.model_xml(
        _PART.replace('v3="7"', 'v3="8"'), '<item objectid="1"/>')), ("8 vertices",),
        ErrorCode.MESH_BAD_INDEX),
    "decimal comma": Refused(d.threemf(d.model_xml(
        _PART.replace('x="80"', 'x="80,5"'), '<item objectid="1"/>')), ("decimal comma", "80,5")),
    "STL": Refused(d.binary_stl(BOX), ("binary STL",)),
}  # fmt: skip

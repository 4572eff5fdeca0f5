"""What a file is that is not what its ending says: the first bytes of many kinds tell."""

from __future__ import annotations

import re

from gpis_grasp_planner.errors import ErrorCode, MeshError

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_HEAD = 4096

# First bytes, what it is, and what to do about it.
_SIGNATURES: tuple[tuple[bytes, str, str], ...] = (
    (b"\x1f\x8b", "compressed by gzip", "Unpack it (gunzip)"),
    (b"BZh", "compressed by bzip2", "Unpack it (bunzip2)"),
    (b"\xfd7zXZ", "compressed by xz", "Unpack it (unxz)"),
    (b"\x28\xb5\x2f\xfd", "compressed by zstd", "Unpack it (unzstd)"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", "Unpack it"),
    (b"Rar!", "a RAR archive", "Unpack it"),
    (b"\xff\xfe", "text in UTF-16", "Save it as UTF-8 or ASCII"),
    (b"\xfe\xff", "text in UTF-16", "Save it as UTF-8 or ASCII"),
    (b"\xd0\xcf\x11\xe0", "a CAD system's own document (OLE)", "Export STEP or STL from it"),
    (b"%PDF", "a PDF document", "Export the mesh itself"),
    (b"\x89PNG", "a PNG picture", "Export the mesh itself"),
    (b"\xff\xd8\xff", "a JPEG picture", "Export the mesh itself"),
    (b"Kaydara FBX", "an FBX file", "Convert it to STL, OBJ or GLB"),
    (b"BLENDER", "a Blender file", "Export STL, OBJ or GLB from it"),
    (b"version https://git-lfs", "only the pointer of a file in Git LFS", "Run 'git lfs pull'"),
    (b"#VRML", "a VRML file", "Convert it to STL, OBJ or GLB"),
    (b"DBRep_DrawableShape", "an OpenCASCADE BREP file", "Export STEP or STL from it"),
)

_TEXTS: tuple[tuple[bytes, str, str], ...] = (
    (rb"\s*(<!doctype html|<html)", "a web page (HTML)", "Download the file itself"),
    (rb"\s*(<\?xml|<collada|<amf|<x3d)", "an XML document", "Convert it to STL, OBJ, 3MF or GLB"),
    (rb"\s*\{.{0,400}\"(asset|accessors|meshes)\"", "a glTF text", "Export GLB, which holds all"),
    (rb"glTF", "a GLB file", "Name it .glb"),
    (rb"\s*ply\s", "a PLY file", "Name it .ply"),
    (rb"\s*(st)?c?n?off[\s\d]", "an OFF file", "Name it .off"),
    (rb"(\s|/\*.{0,2000}?\*/)*iso-10303-21", "a STEP file", "Name it .step"),
    (rb"\s*solid\s.{0,400}?facet\s", "an ASCII STL file", "Name it .stl"),
    (rb".{72}S {6}1\s", "an IGES file", "Export STEP or STL"),
    (rb"(\s|#[^\n\r]*[\n\r])*(mtllib [^\n\r]*|[og] [^\n\r]*|v\s+[-+.\d]+\s)",
     "an OBJ file", "Name it .obj"),
)  # fmt: skip


def foreign(data: bytes) -> tuple[str, str] | None:
    """What the content of a file is and the cure, as two phrases; None where nothing tells.

    An ASCII letter with a zero byte beside it is UTF-16 without its mark.
    """
    for start, what, cure in _SIGNATURES:
        if data.startswith(start):
            return what, cure
    if data.startswith(b"PK\x03\x04"):
        packed_3mf = b"3D/" in data or b"[Content_Types].xml" in data[:_HEAD]
        if packed_3mf:
            return "a ZIP archive, perhaps a 3MF file", "Name it .3mf, or unpack it"
        return "a ZIP archive", "Unpack it"
    if len(data) > 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return "a binary STL file", "Name it .stl"
    head = data[:_HEAD].removeprefix(BYTE_ORDER_MARK)
    start = head[:64]
    every_second_is_zero = not any(start[0::2]) or not any(start[1::2])
    if every_second_is_zero and any(start) and all(b == 0 or 9 <= b < 127 for b in start):
        return "text in UTF-16", "Save it as UTF-8 or ASCII"
    for pattern, what, cure in _TEXTS:
        if re.match(pattern, head, re.IGNORECASE | re.DOTALL):
            return what, cure
    return None


def refuse_foreign(data: bytes, name: str, expected: str) -> None:
    """Raise MESH_UNREADABLE where the content of `data` is known to be something else.

    `expected` is the name of the format that its ending promises, such as 'STL'.
    """
    found = foreign(data)
    if found is None or found[0].split()[-2:] == [expected, "file"]:
        return
    what, cure = found
    raise MeshError(
        f"{name} is no {expected} file: it is {what}. {cure}.", ErrorCode.MESH_UNREADABLE
    )


def refuse_bytes(data: bytes, name: str, expected: str) -> None:
    """As :func:`refuse_foreign`, for a format that is text: zero bytes are not."""
    refuse_foreign(data, name, expected)
    if b"\0" in data[:_HEAD]:
        raise MeshError(
            f"{name} is no {expected} file: it is not a text. Export it again, or name it by its "
            "format."
        )


def is_text(data: bytes) -> bool:
    """Whether the first bytes are those of a text: printable, no zero bytes."""
    head = data[:_HEAD]
    control = sum(1 for b in head if b < 32 and b not in (9, 10, 11, 12, 13, 26, 27))
    return bool(head) and control == 0

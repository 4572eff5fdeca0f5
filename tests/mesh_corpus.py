"""Legal oddities of STL, OBJ, PLY and OFF files, and files that are something else."""

from __future__ import annotations

import bz2
import gzip
import struct
from dataclasses import dataclass

import mesh_dialects as d
import numpy as np
from mesh_dialects import BOX, L_PRISM, Solid

from gpis_grasp_planner.errors import ErrorCode

BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class Read:
    """A file that is read as a solid [mm], moved and scaled; with a note or without."""

    data: bytes
    solid: Solid = BOX
    note: str = ""
    unit: str = "mm"


@dataclass(frozen=True)
class Refused:
    """A file that is refused with a code and words of its true reason."""

    data: bytes
    words: tuple[str, ...]
    code: ErrorCode = ErrorCode.MESH_UNREADABLE


def _interleaved() -> tuple[bytes, Solid]:
    """Three blocks apart from each other, each with indices relative to its own vertices."""
    parts = [d.box((20, 20, 20)).moved((30 * i, 0, 0)) for i in range(3)]
    text = "".join(d.v_lines(p) + d.f_lines(p, relative=True) for p in parts)
    whole = Solid(np.vstack([p.vertices for p in parts]), [], 3 * 8000.0)
    return text.encode(), whole


def _two_solids() -> Solid:
    a, b = d.box((20, 20, 20)), d.box((20, 20, 20)).moved((30, 0, 0))
    return Solid(np.vstack([a.vertices, b.vertices]), [], 16000.0)


TWO = _two_solids()
A, B = d.box((20, 20, 20)), d.box((20, 20, 20)).moved((30, 0, 0))
INTERLEAVED, THREE = _interleaved()
CHECKED_QUAD = "".join(  # a triangle written as a quad with its last corner twice
    "f " + " ".join(str(i + 1) for i in [*t, t[-1]]) + "\n" for t in BOX.triangles
)
# The top's side of an L with points in the middle of its sides, as neighbours' corners make them.
SPLIT_SIDES = d.prism(((0, 0), (30, 0), (60, 0), (60, 40), (30, 40), (0, 40), (0, 20)), 30)

OBJ = {
    "bom": Read(BOM + d.obj(BOX)),
    "tabs": Read(d.obj(BOX).replace(b" ", b"\t")),
    "blanks before": Read(d.obj(BOX).replace(b"v ", b"  v   ").replace(b"f ", b"\t f  ")),
    "crlf": Read(d.obj(BOX).replace(b"\n", b"\r\n")),
    "cr": Read(d.obj(BOX).replace(b"\n", b"\r")),
    "comments": Read(b"# head\n" + d.obj(BOX).replace(b"\n", b" # note\n")),
    "comment with a backslash": Read(b"# from C:\\parts\\\n" + d.obj(BOX)),
    "continued faces": Read(d.obj(BOX, corner="{0} \\\n")),
    "continued at the end": Read(d.obj(BOX)[:-1] + b" \\\n"),
    "continued at the very end": Read(d.obj(BOX)[:-1] + b" \\"),
    "continued vertices": Read(d.v_lines(BOX).replace(" ", " \\\n").encode()
                               + d.f_lines(BOX).encode()),
    "texture": Read(b"vt 0 0\n" + d.obj(BOX, corner="{0}/1")),
    "normals": Read(b"vn 0 0 1\n" + d.obj(BOX, corner="{0}//1")),
    "texture and normals": Read(b"vt 0 0\nvn 0 0 1\n" + d.obj(BOX, corner="{0}/1/1")),
    "negative everywhere": Read(b"vt 0 0\n" + (d.v_lines(BOX) + d.f_lines(
        BOX, corner="{0}/-1", relative=True)).encode()),
    "negative between blocks": Read(INTERLEAVED, THREE),
    "colours": Read((d.v_lines(BOX, end=" 0.5 0.5 0.5") + d.f_lines(BOX)).encode()),
    "weights": Read((d.v_lines(BOX, end=" 1.0") + d.f_lines(BOX)).encode()),
    "colours of some": Read(d.obj(BOX).replace(b"v 80 0 0\n", b"v 80 0 0 1 0 0\n")),
    "faces first": Read((d.f_lines(BOX) + d.v_lines(BOX)).encode()),
    "objects and groups": Read(b"mtllib a.mtl\no one\ng side\nusemtl red\ns off\n" + d.obj(BOX)),
    "two objects": Read((b"o a\n" + d.obj(A) + (b"o b\n" + (d.v_lines(B) + d.f_lines(
        B, relative=True)).encode())), TWO, note="1 'a', 2 'b'"),
    "lines and points": Read(d.obj(BOX) + b"l 1 2 3\np 1\n"),
    "concave polygons": Read(d.obj(L_PRISM), L_PRISM),
    "comb": Read(d.obj(d.prism(d.COMB_OUTLINE, 20)), d.prism(d.COMB_OUTLINE, 20)),
    "corners on sides": Read(d.obj(SPLIT_SIDES), SPLIT_SIDES),
    "triangles as quads": Read((d.v_lines(BOX) + CHECKED_QUAD).encode()),
    "old faces": Read(d.obj(BOX, start="fo ")),
    "no last newline": Read(d.obj(BOX)[:-1]),
    "exponents": Read(d.obj(BOX).replace(b"v 80 ", b"v 8.0E+01 ")),
    "plus signs": Read(d.obj(BOX).replace(b"v 80 ", b"v +80. ")),
    "unknown statement": Read(d.obj(BOX) + b"ray_depth 3\n", note="ray_depth"),
    "an unused vertex that is not finite": Read(d.obj(BOX) + b"v nan 0 0\nv 9e9 0 0\n"),
    "binary STL": Refused(d.binary_stl(BOX), ("binary STL", ".stl")),
    "gzip": Refused(gzip.compress(d.obj(BOX)), ("gzip",)),
    "web page": Refused(b"\n<html><body>404</body></html>\n", ("HTML",)),
    "decimal comma": Refused(d.obj(BOX).replace(b"v 80 ", b"v 80,5 "), ("decimal comma", "80,5")),
    "polygon that crosses itself": Refused(
        d.obj(BOX).replace(b"f 1 2 4 3\n", b"f 1 2 3 4\n"), ("face 1 ", "crosses itself"),
        ErrorCode.MESH_DEGENERATE),
    "curved surfaces": Refused(b"v 0 0 0\nv 1 0 0\nv 1 1 0\ncstype bezier\nsurf 0 1 0 1 1 2 3\n",
                               ("curved surfaces",), ErrorCode.MESH_EMPTY),
    "commas": Refused(d.obj(BOX).replace(b" ", b","), ("no statement of OBJ", "line 1"),
                      ErrorCode.MESH_EMPTY),
    "not finite": Refused(d.obj(BOX).replace(b"v 80 ", b"v inf ", 1), ("not finite", "face "),
                          ErrorCode.MESH_NOT_FINITE),
    "absurd": Refused(d.obj(BOX).replace(b"v 80 ", b"v 1e300 ", 1), ("1e+297",),
                      ErrorCode.MESH_EXTENT_IMPLAUSIBLE),
    "misspelt statement": Refused(d.obj(BOX).replace(b"f 1 2 4 3", b"q 1 2 4 3"),
                                  ("'q'", "line 9", "open")),
}  # fmt: skip

OFF = {
    "bom": Read(BOM + d.off(BOX)),
    "lower case": Read(d.off(BOX, "off\n{v} {f} {e}\n")),
    "counts behind": Read(d.off(BOX, "OFF {v} {f} {e}\n")),
    "counts glued": Read(d.off(BOX, "OFF{v} {f} {e}\n")),
    "counts on lines": Read(d.off(BOX, "OFF\n{v}\n{f}\n{e}\n")),
    "counts without edges": Read(d.off(BOX, "OFF\n{v} {f}\n")),
    "counts on two lines": Read(d.off(BOX, "OFF\n{v} {f}\n{e}\n")),
    "binary STL": Refused(d.binary_stl(BOX), ("binary STL", ".stl")),
    "wrong edges": Read(d.off(BOX, "OFF\n{v} {f} 0\n")),
    "no head": Read(d.off(BOX, "{v} {f} {e}\n")),
    "blanks before": Read(b"\n  \n " + d.off(BOX).replace(b"\n", b"\n  ")),
    "comments": Read(b"# made by hand\n" + d.off(BOX).replace(b"\n", b" # note\n\n# more\n")),
    "crlf": Read(d.off(BOX).replace(b"\n", b"\r\n")),
    "colours": Read(d.off(BOX, "COFF\n{v} {f} {e}\n", vertex_end=" 255 0 0 255")),
    "colours of three": Read(d.off(BOX, "COFF\n{v} {f} {e}\n", vertex_end=" 0.5 0 0")),
    "normals": Read(d.off(BOX, "NOFF\n{v} {f} {e}\n", vertex_end=" 0 0 1")),
    "colours and normals": Read(d.off(BOX, "CNOFF\n{v} {f} {e}\n", vertex_end=" 0 0 1 9 9 9 9")),
    "texture": Read(d.off(BOX, "STOFF\n{v} {f} {e}\n", vertex_end=" 0.5 0.5")),
    "all variants": Read(d.off(BOX, "STCNOFF\n{v} {f} {e}\n", vertex_end=" 0 0 1 9 9 9 9 0 0")),
    "normals and colours": Read(d.off(BOX, "NCOFF\n{v} {f} {e}\n", vertex_end=" 9 9 9 9 0 0 1")),
    "all variants of MeshLab": Read(d.off(
        BOX, "NCSTOFF\n{v} {f} {e}\n", vertex_end=" 9 9 9 9 0 0 1 0 0")),
    "face colours": Read(d.off(BOX, face_end=" 200 10 10")),
    "face colour maps": Read(d.off(BOX, face_end=" 3")),
    "wrapped": Read(d.off(BOX).replace(b"\n0 60", b" 0 60").replace(b"\n4 2", b"\n4\n2")),
    "one line": Read(d.off(BOX).replace(b"\n", b" ") + b"\n"),
    "one line of normals": Read(d.off(BOX, "NOFF {v} {f} {e} ", vertex_end=" 0 0 1").replace(
        b"\n", b" ") + b"\n"),
    "concave polygons": Read(d.off(L_PRISM), L_PRISM),
    "four dimensions": Refused(d.off(BOX, "4OFF\n{v} {f} {e}\n", vertex_end=" 1"), ("4OFF",),
                               ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "binary": Refused(b"OFF BINARY\n" + struct.pack(">3I", 8, 6, 12), ("BINARY",),
                      ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    "text after": Read(d.off(BOX) + b"made by hand\n", note="3 words after"),
    "not finite": Refused(d.off(BOX).replace(b"80 0 0", b"nan 0 0"), ("not finite", "face "),
                          ErrorCode.MESH_NOT_FINITE),
    "one face short": Refused(b"\n".join(d.off(BOX).split(b"\n")[:-2]) + b"\n",
                              ("8 vertices and 6 faces",)),
}  # fmt: skip

_STRIPS = d.triangle_strips(BOX)
_STRIP_VALUES = [i for s in _STRIPS for i in (*s, -1)]


def _strips_ply(order: str) -> bytes:
    head = d.ply_header(
        "ascii" if not order else "binary_little_endian",
        [("vertex", 8, d.XYZ), ("tristrips", 1, ["list int int vertex_indices"])],
    )
    if not order:
        rows = d.v_lines(BOX, start="") + f"{len(_STRIP_VALUES)} "
        return head + (rows + " ".join(map(str, _STRIP_VALUES)) + "\n").encode()
    body = b"".join(struct.pack("<3f", *v) for v in BOX.vertices)
    n = len(_STRIP_VALUES)
    return head + body + struct.pack(f"<{n + 1}i", n, *_STRIP_VALUES)


def _mixed_ply() -> bytes:
    polygons = [BOX.polygons[0], *Solid(BOX.vertices, BOX.polygons[1:], 0).triangles]
    return d.binary_ply(Solid(BOX.vertices, polygons, 0))


def _rich_ply() -> bytes:
    """Properties before and after the lists, lists of texture, an element of its own."""
    head = d.ply_header(
        "binary_little_endian",
        [
            ("camera", 1, ["float view"]),
            ("vertex", 8, [*d.XYZ, "float nx", "uchar red"]),
            (
                "face",
                6,
                ["uchar f", "list uchar uint vertex_index", "list uchar float texcoord"],
            ),
            ("edge", 1, ["int vertex1", "int vertex2"]),
        ],
    )
    body = struct.pack("<f", 1.0)
    body += b"".join(struct.pack("<4fB", *v, 0.0, 9) for v in BOX.vertices)
    body += b"".join(struct.pack("<BB4IB2f", 7, 4, *p, 2, 0.5, 0.5) for p in BOX.polygons)
    return head + body + struct.pack("<2i", 0, 1)


PLY = {
    "ascii": Read(d.ascii_ply(BOX)),
    "ascii bom": Read(BOM + d.ascii_ply(BOX)),
    "ascii crlf": Read(d.ascii_ply(BOX).replace(b"\n", b"\r\n")),
    "ascii cr": Read(d.ascii_ply(BOX).replace(b"\n", b"\r")),
    "ascii mixed": Read(d.ascii_ply(L_PRISM), L_PRISM),
    "ascii colours": Read(d.ascii_ply(BOX, vertex_end=" 9 9 9", face_end=" 1 2",
                                      vertex=(*d.XYZ, "uchar red", "uchar green", "uchar blue"),
                                      face=(d.CORNERS, "uchar a", "uchar b"))),
    "ascii wrapped": Read(d.ascii_ply(BOX).replace(b"\n4 ", b"\n4\n")),
    "ascii text after": Read(d.ascii_ply(BOX) + b"made by hand\n", note="3 words after"),
    "ascii reordered": Read(d.ascii_ply(Solid(BOX.vertices[:, [2, 0, 1]], BOX.polygons, 0),
                                        vertex=("float z", "float x", "float y"))),
    "end of the header in a comment": Read(d.ascii_ply(BOX).replace(
        b"comment a test", b"comment end_header of a test\nobj_info end_header")),
    "ascii strips": Read(_strips_ply("")),
    "little endian": Read(d.binary_ply(BOX)),
    "little endian crlf": Read(d.binary_ply(BOX).replace(b"\n", b"\r\n", 9)),
    "big endian": Read(d.binary_ply(BOX, ">")),
    "long lists": Read(d.binary_ply(BOX, "<", "list int uint vertex_indices", "i{n}I")),
    "short lists": Read(d.binary_ply(BOX, ">", "list uchar ushort vertex_index", "B{n}H")),
    "mixed": Read(_mixed_ply()),
    "mixed concave": Read(d.binary_ply(L_PRISM), L_PRISM),
    "rich": Read(_rich_ply()),
    "strips": Read(_strips_ply("<")),
    "bytes after": Read(d.binary_ply(BOX) + b"\n", note="1 bytes after"),
    "points": Refused(d.ply_header("ascii", [("vertex", 1, d.XYZ)]) + b"0 0 0\n", ("point cloud",),
                      ErrorCode.MESH_EMPTY),
    "not finite": Refused(d.binary_ply(Solid(BOX.vertices * (np.nan, 1, 1), BOX.polygons, 0)),
                          ("not finite",), ErrorCode.MESH_NOT_FINITE),
    "no list": Refused(d.ply_header("ascii", [("vertex", 1, d.XYZ), ("face", 1, ["int a"])])
                       + b"0 0 0\n1\n", ("vertex_indices",)),
}  # fmt: skip

_FACETS = d.facets(BOX)
STL = {
    "ascii bom": Read(BOM + d.ascii_stl(BOX)),
    "ascii cr": Read(d.ascii_stl(BOX).replace(b"\n", b"\r")),
    "ascii crlf": Read(d.ascii_stl(BOX).replace(b"\n", b"\r\n")),
    "ascii tabs": Read(d.ascii_stl(BOX).replace(b" ", b"\t")),
    "ascii upper case": Read(d.ascii_stl(BOX).upper()),
    "ascii one line": Read(d.ascii_stl(BOX).replace(b"\n", b" ") + b"\n"),
    "ascii without a name": Read(("solid\n" + _FACETS + "endsolid").encode()),
    "ascii name of keywords": Read(d.ascii_stl(BOX, "facet vertex endsolid outer loop")),
    "ascii name in Latin-1": Read(d.ascii_stl(BOX, "Gehaeuse").replace(b"ae", b"\xe4")),
    "ascii no endsolid": Read(("solid a\n" + _FACETS).encode(), note="endsolid"),
    "ascii end solid": Read(("solid a\n" + _FACETS + "end solid a\n").encode()),
    "ascii two solids": Read(d.ascii_stl(A, "cover") + d.ascii_stl(B, "base"), TWO,
                             note="1 'cover', 2 'base'"),
    "ascii two solids of one name": Read(d.ascii_stl(A) + d.ascii_stl(B), TWO,
                                         note="1 'part', 2 'part (2)'"),
    "ascii empty solid": Read(b"solid none\nendsolid none\n" + d.ascii_stl(BOX)),
    "ascii text after": Read(d.ascii_stl(BOX) + b"made by a program\n", note="text outside"),
    "ascii NaN normals": Read(d.ascii_stl(BOX, normal="nan -nan(ind) 1.#QNAN")),
    "ascii without normals": Read(d.ascii_stl(BOX).replace(b" normal 0 0 0", b"")),
    "ascii colours and remarks": Read(d.ascii_stl(BOX).replace(
        b" facet", b"color 0.5 0.5 1\n# red\n facet"), note="words between facets"),
    "ascii no endsolid between": Read(d.ascii_stl(A).replace(b"endsolid part\n", b"")
                                      + d.ascii_stl(B), TWO, note="2 words between"),
    "binary one after the other": Read(d.binary_stl(A) + d.binary_stl(B), TWO,
                                       note="2 binary STL files"),
    "binary": Read(d.binary_stl(BOX)),
    "binary solid": Read(d.binary_stl(BOX, b"solid part of a CAD system")),
    "binary text header": Read(d.binary_stl(BOX, b"solid facet normal vertex".ljust(80))),
    "binary NaN normals": Read(d.binary_stl(BOX, normal=float("nan"))),
    "binary colours": Read(d.binary_stl(BOX, b"COLOR=\xff\0\0\xff", attribute=0x7FFF)),
    "binary no count": Read(d.binary_stl(BOX, count=0), note="counts no faces"),
    "binary bytes after": Read(d.binary_stl(BOX) + b"\0", note="1 bytes after"),
    "binary text after": Read(d.binary_stl(BOX) + b"written by us", note="13 bytes after"),
    "gzip": Refused(gzip.compress(d.binary_stl(BOX)), ("gzip", "Unpack")),
    "bzip2": Refused(bz2.compress(d.binary_stl(BOX)), ("bzip2",)),
    "zip": Refused(d.package({"part.stl": d.binary_stl(BOX)}), ("ZIP", "Unpack")),
    "utf-16": Refused(d.ascii_stl(BOX).decode().encode("utf-16"), ("UTF-16",)),
    "utf-16 without a mark": Refused(d.ascii_stl(BOX).decode().encode("utf-16-le"), ("UTF-16",)),
    "web page": Refused(b"<!DOCTYPE html><html>404</html>" + b" " * 100, ("HTML",)),
    "Git LFS": Refused(b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n",
                       ("Git LFS", "git lfs pull")),
    "OBJ": Refused(d.obj(BOX), ("OBJ file", ".obj")),
    "STEP": Refused(b"ISO-10303-21;\nHEADER;\n" + b" " * 80, ("STEP file", ".step")),
    "decimal comma": Refused(d.ascii_stl(BOX).replace(b"vertex 80 ", b"vertex 80,5 "),
                             ("decimal comma", "80,5", "line")),
    "no words but text": Refused(b"solid work on a part\n" * 30, ("facet 1 ",)),
    "ascii control characters": Read(d.ascii_stl(BOX, "a\x01\x00b")),
    "binary no count and bytes after": Read(d.binary_stl(BOX, count=0) + b"x", note="1 bytes"),
    "a facet of four": Refused(d.ascii_stl(BOX).replace(
        b"  endloop", b"   vertex 0 0 0\n  endloop", 1), ("facet 1 ", "line 2")),
    "a word too few": Refused(d.ascii_stl(BOX).replace(b"vertex 80 0 0\n", b"vertex 80 0\n", 1),
                              ("three numbers",)),
}  # fmt: skip

"""Solids with known volumes, and mesh files of them in the many forms that programs write."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Solid:
    """Vertices [mm] and polygons, counter-clockwise from outside."""

    vertices: np.ndarray
    polygons: list[list[int]]
    volume: float  # [mm^3]

    @property
    def triangles(self) -> list[list[int]]:
        """Fans, right for convex polygons only."""
        return [[p[0], p[i], p[i + 1]] for p in self.polygons for i in range(1, len(p) - 1)]

    def moved(self, shift) -> Solid:
        return Solid(self.vertices + np.asarray(shift), self.polygons, self.volume)


def box(size=(80.0, 60.0, 40.0)) -> Solid:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return Solid(corners * np.asarray(size), quads, float(np.prod(size)))


def prism(outline, height: float) -> Solid:
    """A prism over a counter-clockwise outline (n, 2), which may be concave."""
    flat = np.asarray(outline, dtype=float)
    n = len(flat)
    low = np.column_stack([flat, np.zeros(n)])
    high = np.column_stack([flat, np.full(n, float(height))])
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    polygons = [list(range(n))[::-1], list(range(n, 2 * n)), *sides]
    x, y = flat.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    return Solid(np.vstack([low, high]), polygons, area * height)


L_OUTLINE = ((0, 0), (60, 0), (60, 20), (20, 20), (20, 80), (0, 80))
COMB_OUTLINE = ((0, 0), (70, 0), (70, 50), (60, 50), (60, 10), (40, 10), (40, 50), (30, 50),
                (30, 10), (10, 10), (10, 50), (0, 50))  # fmt: skip
BOX = box()
L_PRISM = prism(L_OUTLINE, 30)


def v_lines(solid: Solid, start="v ", end="") -> str:
    return "".join(f"{start}{x:.17g} {y:.17g} {z:.17g}{end}\n" for x, y, z in solid.vertices)


def f_lines(solid: Solid, corner="{0}", start="f ", end="", relative=False) -> str:
    shift = -len(solid.vertices) if relative else 1
    return "".join(
        start + " ".join(corner.format(i + shift) for i in p) + end + "\n" for p in solid.polygons
    )


def obj(solid: Solid, **form) -> bytes:
    return (v_lines(solid) + f_lines(solid, **form)).encode()


def off(solid: Solid, head="OFF\n{v} {f} {e}\n", vertex_end="", face_end="") -> bytes:
    edges = sum(len(p) for p in solid.polygons) // 2
    text = head.format(v=len(solid.vertices), f=len(solid.polygons), e=edges)
    text += v_lines(solid, start="", end=vertex_end)
    text += "".join(f"{len(p)} {' '.join(map(str, p))}{face_end}\n" for p in solid.polygons)
    return text.encode()


def stl_corners(solid: Solid) -> np.ndarray:
    return solid.vertices[np.array(solid.triangles)]


def facets(solid: Solid, normal="0 0 0") -> str:
    return "".join(
        f" facet normal {normal}\n  outer loop\n"
        + "".join(f"   vertex {x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in corners)
        + "  endloop\n endfacet\n"
        for corners in stl_corners(solid)
    )


def ascii_stl(solid: Solid, name="part", normal="0 0 0") -> bytes:
    return f"solid {name}\n{facets(solid, normal)}endsolid {name}\n".encode()


def binary_stl(solid: Solid, header=b"", count=None, normal=0.0, attribute=0) -> bytes:
    triangles = stl_corners(solid)
    body = b"".join(
        struct.pack("<12fH", *3 * [normal], *t.reshape(-1), attribute) for t in triangles
    )
    count = len(triangles) if count is None else count
    return header.ljust(80, b"\0") + struct.pack("<I", count) + body


def ply_header(encoding: str, elements, comments="comment a test\n") -> bytes:
    """`elements`: (name, count, property lines without the word)."""
    text = f"ply\nformat {encoding} 1.0\n{comments}"
    for name, count, properties in elements:
        text += f"element {name} {count}\n" + "".join(f"property {p}\n" for p in properties)
    return (text + "end_header\n").encode()


XYZ = ("float x", "float y", "float z")
CORNERS = "list uchar int vertex_indices"


def binary_ply(solid: Solid, order="<", lists=CORNERS, pack="B{n}i") -> bytes:
    encoding = "binary_little_endian" if order == "<" else "binary_big_endian"
    head = ply_header(
        encoding,
        [("vertex", len(solid.vertices), XYZ), ("face", len(solid.polygons), [lists])],
    )
    body = b"".join(struct.pack(order + "3f", *v) for v in solid.vertices)
    body += b"".join(struct.pack(order + pack.format(n=len(p)), len(p), *p) for p in solid.polygons)
    return head + body


def ascii_ply(solid: Solid, vertex_end="", face_end="", vertex=XYZ, face=(CORNERS,)) -> bytes:
    head = ply_header(
        "ascii", [("vertex", len(solid.vertices), vertex), ("face", len(solid.polygons), face)]
    )
    rows = off(solid, head="", vertex_end=vertex_end, face_end=face_end)
    return head + rows


def triangle_strips(solid: Solid) -> list[list[int]]:
    """Every quad or triangle as a strip of its own."""
    return [[p[0], p[1], p[3], p[2]] if len(p) == 4 else p for p in solid.polygons]


def glb(document: dict, binary: bytes = b"") -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<2I", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<2I", 2, 12 + len(chunks)) + chunks


def glb_document(solid: Solid, scale=1e-3, nodes=None) -> tuple[dict, bytes]:
    """A document with one mesh [m] and the given nodes (default: one)."""
    points = (solid.vertices * scale).astype("<f4")
    indices = np.array(solid.triangles, dtype="<u2")
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))} if nodes else {"nodes": [0]}],
        "nodes": nodes or [{"mesh": 0, "name": "part"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": indices.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": points.nbytes},
            {"buffer": 0, "byteOffset": points.nbytes, "byteLength": indices.nbytes},
        ],
        "buffers": [{"byteLength": points.nbytes + indices.nbytes}],
    }
    return document, points.tobytes() + indices.tobytes()


CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"


def mesh_xml(solid: Solid) -> str:
    vertices = "".join(
        f'<vertex x="{x:.17g}" y="{y:.17g}" z="{z:.17g}"/>' for x, y, z in solid.vertices
    )
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in solid.triangles)
    return f"<mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh>"


def model_xml(resources: str, build: str, unit="millimeter", more="", before="") -> str:
    unit = f' unit="{unit}"' if unit else ""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>{before}<model{unit} xmlns="{CORE}" '
        f'xmlns:p="{PRODUCTION}"{more}><resources>{resources}</resources><build>{build}</build>'
        "</model>"
    )


def package(files: dict[str, str | bytes], compression=zipfile.ZIP_DEFLATED) -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return target.getvalue()


def threemf(model: str, more: dict[str, str | bytes] | None = None, path="3D/3dmodel.model"):
    relationships = (
        '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
        f'<Relationship Target="/{path}" Id="r" '
        'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
    )
    return package({"_rels/.rels": relationships, path: model, **(more or {})})


def simple_3mf(solid: Solid, unit="millimeter", transform="") -> bytes:
    attribute = f' transform="{transform}"' if transform else ""
    return threemf(
        model_xml(
            f'<object id="1" type="model" name="part">{mesh_xml(solid)}</object>',
            f'<item objectid="1"{attribute}/>',
            unit,
        )
    )

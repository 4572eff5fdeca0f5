"""Clouds of bodies that are known by formula, for the tests of point clouds."""

from __future__ import annotations

import struct

import numpy as np

RADIUS = 0.04
CENTER = np.array([0.1, -0.05, 0.3])


def sphere_points(rng, n=3000, noise=0.0, cap=-1.0):
    """Points (n, 3) of a ball's surface about CENTER with z of the normal above `cap`, normals."""
    z = rng.uniform(cap, 1.0, n)
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    r = np.sqrt(1.0 - z**2)
    normals = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    return CENTER + RADIUS * normals + noise * rng.normal(size=(n, 3)), normals


def box_points(rng, size=(0.06, 0.05, 0.04), n=4000, noise=0.0):
    """Points (n, 3) of a box about the origin, and outward normals."""
    size = np.asarray(size)
    areas = np.repeat([size[1] * size[2], size[0] * size[2], size[0] * size[1]], 2)
    side = rng.choice(6, n, p=areas / areas.sum())
    points = rng.uniform(-0.5, 0.5, (n, 3)) * size
    sign = np.where(side % 2, 1.0, -1.0)
    points[np.arange(n), side // 2] = 0.5 * sign * size[side // 2]
    normals = np.zeros((n, 3))
    normals[np.arange(n), side // 2] = sign
    return points + noise * rng.normal(size=(n, 3)), normals


def xyz(points) -> bytes:
    """The text of an XYZ file."""
    return "\n".join(" ".join(f"{v:.9g}" for v in row) for row in points).encode() + b"\n"


def pcd(points, encoding="binary", viewpoint=(0, 0, 0), declared=None) -> bytes:
    """A PCD file of single precision; `declared` is the count that its header claims."""
    count = len(points) if declared is None else declared
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT {' '.join(map(str, viewpoint))} 1 0 0 0\n"
        f"POINTS {count}\nDATA {encoding}\n"
    ).encode()
    if encoding == "ascii":
        return head + b"".join(b"%.9g %.9g %.9g 7\n" % tuple(row) for row in points)
    rows = np.zeros(len(points), dtype=[("p", "<f4", 3), ("rgb", "<u4")])
    rows["p"] = points
    if encoding == "binary_compressed":  # field by field, as literal runs of LZF
        raw = b"".join(rows["p"][:, k].tobytes() for k in range(3)) + rows["rgb"].tobytes()
        runs = [raw[i : i + 32] for i in range(0, len(raw), 32)]
        packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
        return head + struct.pack("<2I", len(packed), len(raw)) + packed
    return head + rows.tobytes()


def ply(points, normals=None, camera=None) -> bytes:
    """An ASCII PLY file without faces."""
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    rows = np.asarray(points)
    if normals is not None:
        lines += [f"property float n{axis}" for axis in "xyz"]
        rows = np.concatenate([rows, normals], axis=1)
    if camera is not None:
        lines += ["element camera 1", *(f"property float view_p{axis}" for axis in "xyz")]
    lines += ["end_header", *(" ".join(f"{v:.9g}" for v in row) for row in rows)]
    if camera is not None:
        lines.append(" ".join(f"{v:.9g}" for v in camera))
    return "\n".join([*lines, ""]).encode()

"""PyBullet's distances against shapes whose distances are known."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.scene.bullet_world import (
    BulletWorld,
    bullet_client,
    concave_bodies,
    convex_body,
)

SIDE = 0.8


def slab(half: float = SIDE / 2) -> TriangleMesh:
    """A cube about the origin, every face two triangles."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    return TriangleMesh(corners, np.array(faces, dtype=np.int32))


@pytest.fixture(scope="module")
def hand() -> HandDescription:
    return load_hand()


@pytest.fixture(scope="module")
def world(hand: HandDescription) -> Iterator[BulletWorld]:
    with BulletWorld(hand, slab()) as world:
        yield world


def lowest(hand: HandDescription, T: np.ndarray, joints: np.ndarray, link: int) -> float:
    """Height of a link's lowest vertex, from the description alone."""
    pose = T @ link_transforms(hand, joints)[0, link]
    points = np.concatenate([piece.vertices for piece in hand.link_collision[link]])
    return float((points @ pose[2, :3] + pose[2, 3]).min())


def test_distances_of_all_links_over_a_face(
    world: BulletWorld, hand: HandDescription, rng: np.random.Generator
) -> None:
    for _ in range(20):
        joints = rng.uniform(hand.joint_lower, hand.joint_upper)
        joints[1] = joints[0]
        T = np.eye(4)
        T[:3, :3] = np.diag([1.0, -1.0, -1.0])  # the palm looks down at the cube
        for link in range(hand.n_links):
            T[2, 3] = 0.0
            T[2, 3] = SIDE / 2 + 0.003 - lowest(hand, T, joints, link)
            world.place_palm(T)
            world.set_joints(joints)
            assert world.gap(link, 0.01) == pytest.approx(0.003, abs=2e-5)


@pytest.mark.parametrize("depth", [0.0002, 0.001, 0.004])
def test_depth_of_the_palm_in_a_face(
    world: BulletWorld, hand: HandDescription, depth: float
) -> None:
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    joints = np.zeros(hand.n_joints)
    T[2, 3] = SIDE / 2 - depth - lowest(hand, T, joints, 0)
    world.place_palm(T)
    world.set_joints(joints)
    assert world.penetration(0) == pytest.approx(depth, abs=2e-5)
    assert world.hand_gap(0.01) <= -depth + 2e-5


def test_a_link_wholly_inside_is_deep(world: BulletWorld, hand: HandDescription) -> None:
    world.set_joints(np.zeros(hand.n_joints))
    distal = hand.fingers[0].distal_link
    T = np.eye(4)
    T[:3, 3] = -link_transforms(hand, np.zeros(hand.n_joints))[0, distal, :3, 3]
    world.place_palm(T)
    assert len(world.closest(distal, 0.0)) == 0
    assert world.penetration(distal) > 0.05


def test_contacts_are_those_of_the_bodies(world: BulletWorld, hand: HandDescription) -> None:
    """A link flat over a face touches it with the face's normal, and not with its diagonal."""
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    joints = np.zeros(hand.n_joints)
    T[2, 3] = SIDE / 2 + 1e-4 - lowest(hand, T, joints, 0)
    world.place_palm(T)
    world.set_joints(joints)
    found = world.contacts(0, 2e-4)
    assert len(found) >= 1
    assert np.allclose(found.normals_inward, [0.0, 0.0, -1.0], atol=1e-2)
    assert np.allclose(found.on_object[:, 2], SIDE / 2, atol=1e-6)
    assert (found.distances < 2e-4).all()
    assert len(world.contacts(0, 5e-5)) == 0


def waves(n: int, rng: np.random.Generator, height: float = 0.01) -> TriangleMesh:
    """A sheet of 2 (n - 1)^2 triangles over the unit square, a new one each time."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, n), np.linspace(-0.1, 0.1, n), indexing="ij")
    z = -height * rng.random((n, n))
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
    return TriangleMesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces.astype(np.int32))


def resident_mib() -> float:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20


def test_worlds_of_many_meshes_leave_no_memory_behind(rng: np.random.Generator) -> None:
    """PyBullet keeps the lists it is given: 1 MiB a mesh of this size with a new list for each."""

    def make(count: int) -> None:
        for _ in range(count):
            with bullet_client() as client:
                concave_bodies(client, waves(80, rng))

    make(10)
    before = resident_mib()
    make(40)
    assert resident_mib() - before < 8.0


def test_a_mesh_beyond_bullets_limit_of_indices_is_taken_in_pieces(
    rng: np.random.Generator,
) -> None:
    mesh = waves(350, rng, height=0.0)
    assert len(mesh.faces) > 524_288 / 3
    with bullet_client() as client:
        bodies = concave_bodies(client, mesh)
        assert len(bodies) == 3
        cube = convex_body(client, slab(0.0005))
        for x, y in rng.uniform(-0.09, 0.09, (30, 2)):
            client.resetBasePositionAndOrientation(cube, (x, y, 0.003), (0.0, 0.0, 0.0, 1.0))
            rows = [r for body in bodies for r in client.getClosestPoints(cube, body, 0.01)]
            assert min(r[8] for r in rows) == pytest.approx(0.0025, abs=2e-5)

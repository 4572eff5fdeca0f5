"""A document carries enough to recompute its figures, and a bad one is refused by name."""

from __future__ import annotations

import copy
import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull, QhullError

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.catalogue import (
    MeshCatalogue,
    default_catalogue_directory,
    load_part,
)
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.lost_palms import MOST_OF_A_CAUSE
from gpis_grasp_planner.hand.open_hand import JointCount
from gpis_grasp_planner.plan.document import (
    MeshSource,
    check_same_mesh,
    document_of,
    document_text,
    read_document,
    write_document,
)
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
from gpis_grasp_planner.surroundings.forbidden_region import ForbiddenRegion

ATTEMPTS = 256


@pytest.fixture(scope="module")
def part() -> Part:
    return MeshCatalogue([default_catalogue_directory()]).load("mug")


@pytest.fixture(scope="module")
def result(part: Part) -> PlanResult:
    request = PlanRequest(
        planner="hpp",
        seed=3,
        n_grasps=6,
        max_evaluations=ATTEMPTS,
        time_budget_s=120.0,
        friction=Friction(0.5, 0.35),
    )
    answer = GraspPlanner().plan(part, request)
    assert len(answer.grasps) >= 3
    return answer


@pytest.fixture
def document(result: PlanResult) -> dict:
    return json.loads(document_text(result))


def independent_quality(document: dict, grasp: dict) -> tuple[float, float, float]:
    """Epsilon and volume by the document's own recipe, and how exactly they are known (relative).

    With plain numpy and Qhull. Contacts on one plane can make many wrenches cospherical, which
    Qhull refuses; moving each by 1e-11 at random then decides.
    """
    center = np.array(document["center_of_mass"])
    m = document["cone_edges"]
    wrenches = []
    for contact in grasp["contacts"]:
        n = np.array(contact["normal_inward"])
        p = np.array(contact["position"])
        axis = np.array([0.0, 0.0, 1.0] if abs(n[0]) > 1.0 - 1e-7 else [1.0, 0.0, 0.0])
        t_y = np.cross(n, axis)
        t_y = t_y / np.sqrt(t_y @ t_y)
        t_x = np.cross(t_y, n)
        for j in range(m):
            angle = 2.0 * math.pi * j / m
            force = n + contact["friction"] * (math.cos(angle) * t_x + math.sin(angle) * t_y)
            torque = np.cross(p - center, force) / document["torque_scale"]
            wrenches.append(np.concatenate([force, torque]))
    exact = 1e-9
    try:
        hull = ConvexHull(np.array(wrenches))
    except QhullError:
        exact = 1e-7
        moved = np.random.default_rng(0).normal(scale=1e-11, size=(len(wrenches), 6))
        hull = ConvexHull(np.array(wrenches) + moved)
    # Qhull's facets: normal . x + offset <= 0 inside, so the origin lies -offset within.
    return float(-hull.equations[:, -1].max()), float(hull.volume), exact


def winding_number(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """1 inside, 0 outside: the solid angle of all triangles over 4 pi (van Oosterom, Strackee)."""
    a, b, c = (mesh.triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    determinant = np.einsum("pti,pti->pt", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("pti,pti->pt", u, v) for u, v in ((a, b), (b, c), (c, a)))
    angle = 2.0 * np.arctan2(determinant, la * lb * lc + ab * lc + bc * la + ca * lb)
    return angle.sum(axis=1) / (4.0 * np.pi)


def test_epsilon_and_volume_recompute_from_the_document_alone(document: dict) -> None:
    exactness = []
    for grasp in document["grasps"]:
        epsilon, volume, exact = independent_quality(document, grasp)
        assert grasp["epsilon"] > 0.0
        assert grasp["epsilon"] == pytest.approx(epsilon, rel=exact, abs=1e-12)
        assert grasp["volume"] == pytest.approx(volume, rel=exact)
        exactness.append(exact)
    assert exactness.count(1e-9) >= 2


def test_contacts_lie_on_the_mesh_file_within_the_threshold(document: dict) -> None:
    mesh = trimesh.load(default_catalogue_directory() / "mug.stl")
    mesh.apply_scale(1e-3)  # the file is in millimetres, the document in metres
    for grasp in document["grasps"]:
        positions = np.array([c["position"] for c in grasp["contacts"]])
        normals = np.array([c["normal_inward"] for c in grasp["contacts"]])
        _, distance, _ = trimesh.proximity.closest_point_naive(mesh, positions)
        assert distance.max() <= document["contact_threshold"] + 1e-7
        # 2 mm along the inward normal is inside the wall of 6 mm, 2 mm against it outside.
        np.testing.assert_allclose(winding_number(mesh, positions + 2e-3 * normals), 1, atol=1e-6)
        np.testing.assert_allclose(winding_number(mesh, positions - 2e-3 * normals), 0, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)


def test_mass_centre_and_torque_scale_are_those_of_the_mesh_file(document: dict) -> None:
    mesh = trimesh.load(default_catalogue_directory() / "mug.stl")
    mesh.apply_scale(1e-3)
    np.testing.assert_allclose(document["center_of_mass"], mesh.center_mass, atol=1e-7)
    farthest = np.linalg.norm(mesh.vertices - mesh.center_mass, axis=1).max()
    assert document["torque_scale"] == pytest.approx(farthest, rel=1e-6)


def test_friction_is_per_pair_of_link_and_object(document: dict) -> None:
    palm_like = {"bh_palm_link", "bh_finger_3_knuckle_link"}
    palm_like |= {link for link in document["link_names"] if "knuckle" in link}
    values = {"finger": set(), "palm": set()}
    for grasp in document["grasps"]:
        for contact in grasp["contacts"]:
            group = "palm" if contact["link"] in palm_like else "finger"
            values[group].add(contact["friction"])
    assert values["finger"] == {document["friction"]["finger"]} == {0.5}
    assert values["palm"] <= {0.5, document["friction"]["palm"]}


def test_the_hash_is_made_as_the_document_says(document: dict, part: Part) -> None:
    digest = hashlib.sha256()
    digest.update(part.mesh.vertices.astype("<f8").tobytes())
    digest.update(part.mesh.faces.astype("<i4").tobytes())
    assert document["mesh_hash"] == digest.hexdigest()
    assert "float64" in document["mesh_hash_recipe"]


def test_a_document_reads_back_as_it_was_written(tmp_path: Path, result: PlanResult) -> None:
    source = MeshSource("parts/mug.step", "inch", "cup")
    write_document(tmp_path / "grasps.json", result, source)
    read = read_document(tmp_path / "grasps.json")
    assert read.mesh_source == source
    assert len(read.result.grasps) == len(result.grasps)
    for ours, theirs in zip(read.result.grasps, result.grasps, strict=True):
        np.testing.assert_allclose(ours.T_object_palm, theirs.T_object_palm, atol=1e-14)
        np.testing.assert_array_equal(ours.joints, theirs.joints)
        np.testing.assert_array_equal(ours.pregrasp_joints, theirs.pregrasp_joints)
        np.testing.assert_array_equal(ours.contacts.positions, theirs.contacts.positions)
        np.testing.assert_array_equal(ours.contacts.links, theirs.contacts.links)
        np.testing.assert_array_equal(ours.contacts.friction, theirs.contacts.friction)
        assert (ours.epsilon, ours.volume) == (theirs.epsilon, theirs.volume)
    assert read.result.funnel == result.funnel
    assert list(read.result.lost_palms.positions) == list(result.lost_palms.positions)
    assert result.lost_palms.positions.keys() <= result.funnel.lost.keys()
    for key, rows in result.lost_palms.positions.items():
        lost = result.funnel.lost[key]
        assert min(lost, MOST_OF_A_CAUSE // 2) <= len(rows) <= min(lost, MOST_OF_A_CAUSE)
        np.testing.assert_allclose(read.result.lost_palms.positions[key], rows, atol=5.1e-6)
    assert read.result.phase_s == result.phase_s
    again = document_of(read.result, read.mesh_source)
    first = json.loads((tmp_path / "grasps.json").read_text())
    for values in (again, first):
        for grasp in values["grasps"]:
            grasp["palm_pose"]["orientation_xyzw"] = None  # through a matrix: not to the bit
    assert again == first


def test_what_grasps_had_to_respect_is_in_the_document(
    tmp_path: Path, result: PlanResult, document: dict
) -> None:
    region = ForbiddenRegion(np.eye(4), np.array([0.01, 0.02, 0.03]), "thread", 0.001)
    request = replace(
        result.request, approach=ApproachCone(np.array([0, 0, -1.0]), 25.0), forbidden=(region,)
    )
    write_document(tmp_path / "grasps.json", replace(result, request=request))
    read = read_document(tmp_path / "grasps.json").result.request
    assert read.approach is not None
    assert read.approach.as_mapping() == request.approach.as_mapping()  # type: ignore[union-attr]
    assert [r.as_mapping() for r in read.forbidden] == [region.as_mapping()]
    # documents from before there were constraints are read as without any
    earlier = json.loads(json.dumps(document))
    del earlier["approach"], earlier["forbidden"]
    for grasp in earlier["grasps"]:
        grasp.pop("imbalance", None)
        for outcome in grasp["trials"] or ():
            outcome.pop("closing_slip_m")
    (tmp_path / "earlier.json").write_text(json.dumps(earlier))
    read = read_document(tmp_path / "earlier.json").result.request
    assert (read.approach, read.forbidden) == (None, ())


def test_the_order_of_joints_is_that_of_the_hand(document: dict) -> None:
    for grasp in document["grasps"]:
        assert grasp["joint_names"] == document["joint_names"]
        assert len(grasp["joint_positions"]) == len(grasp["pregrasp_joint_positions"]) == 8


def test_no_grasp_is_a_document_too(tmp_path: Path, part: Part) -> None:
    slippery = PlanRequest(
        planner="random",
        max_evaluations=32,
        time_budget_s=60.0,
        friction=Friction(0.01, 0.01),
    )
    nothing = GraspPlanner().plan(part, slippery)
    assert nothing.code == ErrorCode.NO_FEASIBLE_GRASP
    write_document(tmp_path / "none.json", nothing)
    read = read_document(tmp_path / "none.json").result
    assert read.code == ErrorCode.NO_FEASIBLE_GRASP
    assert read.message == nothing.message
    assert read.grasps == ()


def test_another_mesh_is_refused(result: PlanResult, part: Part, tmp_path: Path) -> None:
    check_same_mesh(result, part)
    scaled = tmp_path / "mug.stl"
    trimesh.creation.box((0.05, 0.06, 0.07)).export(scaled)
    with pytest.raises(RequestError, match=result.mesh_hash[:16]) as caught:
        check_same_mesh(result, load_part(scaled, "m"))
    assert caught.value.code == ErrorCode.INVALID_DOCUMENT


def _set(path: str, value: object):  # type: ignore[no-untyped-def]
    def change(document: dict) -> None:
        *parents, last = path.split(".")
        node = document
        for key in parents:
            node = node[int(key)] if isinstance(node, list) else node[key]
        if value is KeyError:
            del node[last]
        else:
            node[int(last) if isinstance(node, list) else last] = value

    return change


@pytest.mark.parametrize(
    ("path", "value", "word"),
    [
        ("place", {"table": 1}, "'place'.*'table'"),
        ("place", [], "'place'"),
        ("grasps.0.hold_probability", 1.5, "hold_probability"),
        ("grasps.0.lift_direction", [0.0, 0.0, 2.0], "lift_direction"),
        ("approach", {"axis": [0, 0, 1], "half_angle_deg": 200}, "0 to 180"),
        ("forbidden", [{"size": [1, 1]}], "3 finite numbers"),
        ("schema", "something else", "schema"),
        ("schema_version", 1, "schema_version"),
        ("seed", KeyError, "lacks seed"),
        ("extra", 1, "unknown"),
        ("seed", -1, "seed"),
        ("seed", 1.5, "seed"),
        ("seed", True, "seed"),
        ("code", 9999, "code"),
        ("status", "BUSY", "SUCCESS"),
        ("code", 400, "status"),
        ("grasps", [], "SUCCESS exactly"),
        ("mesh_hash", "abc", "mesh_hash"),
        ("length_unit", "mm", "length_unit"),
        ("torque_scale", 0.0, "torque_scale"),
        ("center_of_mass", [0.0, 0.0], "center_of_mass"),
        ("cone_edges", 2, "cone_edges"),
        ("time_budget_s", 1e9, "time budget"),
        ("mesh_source", {"file": "a.stl", "unit": "foot"}, "mesh_source.unit"),
        ("settings", {"hpp": 3}, "settings"),
        ("notes", "none", "notes"),
        ("phase_s", {"searching": -1.0}, "phase_s.searching"),
        ("phase_s", [], "'phase_s'"),
        ("funnel.0.left", 1, "add up|were lost|are left"),
        ("funnel.3.left", 10**9, "are left by the losses"),
        ("funnel.2.step", "open", "steps are proposed"),
        ("funnel.4.lost", {"no force closure": 0}, "no force closure"),
        ("lost_palms.0.step", "open", "one of proposed"),
        ("lost_palms.0.positions.0", [1.0, 2.0], "positions"),
        ("grasps.0.palm_pose.orientation_xyzw", [0.0, 0.0, 0.0, 0.0], "orientation_xyzw"),
        ("grasps.0.palm_pose.orientation_xyzw.3", 7.0, "orientation_xyzw"),
        ("grasps.0.palm_pose.position.0", "0.1", r"grasps\[0\].palm_pose.position\[0\]"),
        ("grasps.1.joint_positions", [0.0] * 7, r"grasps\[1\].joint_positions"),
        ("grasps.0.joint_names", ["a"] * 8, "joint_names"),
        ("grasps.0.contacts.0.link", "thumb", "bh_palm_link"),
        ("grasps.0.contacts.0.normal_inward", [1.0, 1.0, 0.0], "length 1"),
        ("grasps.0.contacts.0.friction", -0.1, "friction"),
        ("grasps.0.epsilon", -2.0, "epsilon"),
        ("grasps.0.volume", None, "volume"),
    ],
)
def test_a_bad_field_is_named(
    tmp_path: Path, document: dict, path: str, value: object, word: str
) -> None:
    bad = copy.deepcopy(document)
    _set(path, value)(bad)
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(bad))
    with pytest.raises(RequestError, match=word) as caught:
        read_document(file)
    assert caught.value.code == ErrorCode.INVALID_DOCUMENT


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{",
        "\x00\xff",
        '{"schema": "gpis_grasp_planner/grasps", "schema": "gpis_grasp_planner/grasps"}',
        '{"schema": "gpis_grasp_planner/grasps", "seed": NaN}',
        "[" * 100_000,
    ],
    ids=["empty", "list", "cut", "bytes", "twice", "nan", "deep"],
)
def test_what_is_no_document_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "bad.json"
    file.write_bytes(text.encode("latin-1"))
    with pytest.raises(RequestError, match=r"bad\.json") as caught:
        read_document(file)
    assert caught.value.code == ErrorCode.INVALID_DOCUMENT


def test_a_missing_file_and_a_directory_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "nothing.json", tmp_path):
        with pytest.raises(RequestError, match="Cannot read") as caught:
            read_document(path)
        assert caught.value.code == ErrorCode.INVALID_DOCUMENT


@pytest.mark.parametrize("value", ["1e400", "-1e400"])
def test_a_number_beyond_all_bounds_is_refused(tmp_path: Path, document: dict, value: str) -> None:
    text = json.dumps(document).replace(f'"mass": {document["mass"]!r}', f'"mass": {value}')
    assert value in text
    (tmp_path / "bad.json").write_text(text)
    with pytest.raises(RequestError, match="mass"):
        read_document(tmp_path / "bad.json")


def test_joints_leave_and_come_back_as_the_urdf_counts_them(result: PlanResult, tmp_path: Path):
    n = len(result.joint_names)
    count = JointCount(0.1 * np.arange(n), np.where(np.arange(n) % 2, -1.0, 1.0))
    counted = replace(result, joint_count=count)
    values = document_of(counted)["grasps"][0]["joint_positions"]
    np.testing.assert_allclose(values, count.zero + count.sense * result.grasps[0].joints)
    write_document(tmp_path / "a.json", counted)
    back = read_document(tmp_path / "a.json").result
    for read, planned in zip(back.grasps, result.grasps, strict=True):
        np.testing.assert_allclose(read.joints, planned.joints, atol=1e-15)
        np.testing.assert_allclose(read.pregrasp_joints, planned.pregrasp_joints, atol=1e-15)
    np.testing.assert_array_equal(back.joint_count.sense, count.sense)
    values = json.loads((tmp_path / "a.json").read_text())
    del values["open_hand"]  # as earlier programs wrote them
    (tmp_path / "a.json").write_text(json.dumps(values))
    assert not read_document(tmp_path / "a.json").result.joint_count.zero.any()
    values["open_hand"] = {"zero": [0.0] * n, "sense": [2.0] * n}
    (tmp_path / "a.json").write_text(json.dumps(values))
    with pytest.raises(RequestError, match=r"open_hand.sense. is .*1 or -1"):
        read_document(tmp_path / "a.json")

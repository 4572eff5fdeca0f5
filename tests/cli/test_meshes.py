from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from cloud_shapes import sphere_points, xyz

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory


def test_the_shipped_parts_are_listed(gpis_grasp) -> None:
    answer = gpis_grasp("meshes")
    assert answer.code == 0
    catalogue = MeshCatalogue([default_catalogue_directory()])
    for mesh_id in catalogue.ids():
        [line] = [row for row in answer.out.splitlines() if row.split()[:1] == [mesh_id]]
        assert f"{catalogue.load(mesh_id).mass:.3g}" in line
    facts = {one["id"]: one for one in json.loads(gpis_grasp("meshes", "--json").out)}
    assert list(facts) == catalogue.ids()
    mug = catalogue.load("mug")
    assert facts["mug"]["mesh_hash"] == mug.mesh.content_hash
    assert facts["mug"]["mass_kg"] == mug.mass
    assert "size [mm]" in answer.out
    assert "mass [kg]" in answer.out


def test_a_bad_mesh_is_listed_with_its_fault(gpis_grasp, tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_bytes(b"")
    shipped = default_catalogue_directory()
    (tmp_path / "good.stl").write_bytes((shipped / "mug.stl").read_bytes())
    answer = gpis_grasp("meshes", "--meshes", tmp_path, "--set", "catalogue.default_unit=mm")
    assert answer.code == 1
    assert "MESH_EMPTY" in answer.out
    listed = gpis_grasp(
        "meshes", "--meshes", tmp_path, "--json", "--set", "catalogue.default_unit=mm"
    )
    assert listed.code == 1
    assert [one.get("error") for one in json.loads(listed.out)] == ["MESH_EMPTY", None]
    assert "119 x 84 x 95" in answer.out


def test_a_file_that_no_id_can_name_is_listed(gpis_grasp, tmp_path: Path) -> None:
    shipped = default_catalogue_directory()
    (tmp_path / "hole coupon.stl").write_bytes((shipped / "mug.stl").read_bytes())
    (tmp_path / "gearbox").mkdir()
    (tmp_path / "gearbox" / "mug.stl").write_bytes((shipped / "mug.stl").read_bytes())
    answer = gpis_grasp("meshes", "--meshes", tmp_path, "--set", "catalogue.default_unit=mm")
    text = " ".join(answer.out.split())
    assert "gearbox/mug" in text
    assert "hole coupon.stl cannot be asked for: the file's name has a blank" in text
    assert "hole_coupon.stl" in text


def test_a_point_cloud_is_listed_as_one(gpis_grasp, tmp_path: Path) -> None:
    points, _ = sphere_points(np.random.default_rng(5), 1500, 0.0005)
    (tmp_path / "ball.xyz").write_bytes(xyz(points))
    (tmp_path / "ball.yaml").write_text("unit: m\n")
    listed = gpis_grasp("meshes", "--meshes", tmp_path)
    [line] = [row for row in listed.out.splitlines() if row.split()[:1] == ["ball"]]
    assert "cloud, noted" in line
    [fact] = json.loads(gpis_grasp("meshes", "--meshes", tmp_path, "--json").out)
    assert 0.0 < fact["surface_deviation_m"] < 0.01
    shipped = json.loads(gpis_grasp("meshes", "--json").out)
    assert {one["surface_deviation_m"] for one in shipped} == {None}

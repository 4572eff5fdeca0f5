"""The YAML beside a mesh: what it may say, and how it is refused."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.materials import MATERIALS
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.sidecar import KEYS, MAX_SIDECAR_BYTES, Sidecar, parse_sidecar
from gpis_grasp_planner.geometry.units import UNITS


def parsed(text: str) -> Sidecar:
    return parse_sidecar(text.encode(), "part.yaml")


def test_everything_it_may_say():
    sidecar = parsed(
        "description: a part\nunit: mm\nmass: 0.3\ncenter_of_mass: [0.01, -2e-2, 0]\n"
        "friction: {finger: 0.4, palm: 0.3}\nmaterial: steel\nscale: 2\nbody: cover\n"
    )
    assert sidecar.scale == 2.0
    assert sidecar.body == "cover"
    assert sidecar.unit == "mm"
    assert sidecar.mass == 0.3
    assert sidecar.density is None  # the mass is given, the material's density has no say
    np.testing.assert_array_equal(sidecar.center_of_mass, (0.01, -0.02, 0.0))
    assert sidecar.friction == Friction(0.4, 0.3)


@pytest.mark.parametrize("text", ["", "# nothing\n", "---\n"])
def test_it_may_say_nothing(text):
    assert vars(parsed(text)) == vars(Sidecar())


@pytest.mark.parametrize(("text", "value"), [("1e-3", 1e-3), ("5E0", 5.0), (".5", 0.5), ("2", 2.0)])
def test_numbers_may_be_written_as_anywhere_else(text, value):
    assert parsed(f"mass: {text}").mass == value


def test_one_friction_is_for_finger_and_palm():
    assert parsed("friction: 0.5").friction == Friction(0.5, 0.5)


@pytest.mark.parametrize("material", MATERIALS)
def test_a_material_gives_density_and_friction(material):
    sidecar = parsed(f"material: {material}")
    assert sidecar.density == MATERIALS[material].density
    assert sidecar.friction == MATERIALS[material].friction
    stated = parsed(f"material: {material}\ndensity: 123\nfriction: 0.9")
    assert stated.density == 123.0
    assert stated.friction == Friction(0.9, 0.9)


def test_the_paper_s_materials_have_its_friction():
    assert MATERIALS["glass"].friction == Friction(0.3, 0.2)
    assert MATERIALS["plastic"].friction == Friction(0.4, 0.3)
    assert MATERIALS["wood"].friction == Friction(0.4, 0.4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("units: mm", "'units'; known are unit, mass"),
        ("unit: foot", "'foot'; choose one of m, cm, mm, um, inch"),
        ("unit: [mm]", "choose one of"),
        ("scale: 0", "0; it must be 1e-09 to 1e+09"),
        ("scale: .nan", "nan"),
        ("scale: true", "True"),
        ("body: 0", "number from 1"),
        ("body: true", "True"),
        ("body: ''", "body's name"),
        ("body: [1]", "body's name"),
        ("unit: 1", "choose one of"),
        ("unit: mm\nunit: m", "'unit' is given twice"),
        ("mass: 0", "above 0 and at most 1000 kg"),
        ("mass: -1", "-1"),
        ("mass: .nan", "nan"),
        ("mass: .inf", "inf"),
        ("mass: '1'", "'1'"),
        ("mass: true", "True"),
        ("mass: 1\ndensity: 1", "both mass and density"),
        ("density: 1e9", "30000 kg/m3"),
        ("friction: 0", "0.01 to 5"),
        ("friction: 6", "0.01 to 5"),
        ("friction: 0.005", "0.01 to 5"),
        ("friction: .nan", "nan"),
        ("friction: {finger: 0.3}", "both finger and palm"),
        ("friction: {finger: 0.3, palm: 0.2, thumb: 1}", "both finger and palm"),
        ("friction: {finger: 0.3, palm: -0.2}", "palm"),
        ("material: unobtainium", "known are abs, aluminium"),
        ("material: [steel]", "known are"),
        ("center_of_mass: [0, 0]", "three numbers"),
        ("center_of_mass: 3", "three numbers"),
        ("center_of_mass: [0, 0, .nan]", "three numbers"),
        ("center_of_mass: [0, 0, 43]", "in metres"),
        ("description: [1]", "description"),
        ("- unit", "keys and values"),
        ("unit", "keys and values"),
        ("unit: [", "not valid YAML"),
        ("!!python/object/apply:os.system ['true']", "not valid YAML"),
        ("1: 2", "unknown key"),
        ("[1, 2]: 3", "not valid YAML"),
        ("a: &a [x, x]\nb: &b [*a, *a]", "unknown key"),
        (f"mass: {10**400}", "above 0"),
        ("[" * 3000, "not valid YAML"),
        ("#" * (MAX_SIDECAR_BYTES + 1), "the limit is"),
    ],
)
def test_what_is_refused_and_how(text, said):
    with pytest.raises(MeshError) as caught:
        parsed(text)
    assert caught.value.code == ErrorCode.MESH_SIDECAR_INVALID
    assert said in caught.value.message
    assert caught.value.message.startswith("part.yaml ")
    assert len(caught.value.message) < 400


def test_bytes_that_are_no_text():
    with pytest.raises(MeshError, match="not valid YAML"):
        parse_sidecar(b"unit: \xff\xfe", "part.yaml")


yaml_values = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5),
    st.lists(st.floats(), max_size=4),
)  # fmt: skip


@given(st.dictionaries(st.sampled_from(KEYS), yaml_values, max_size=4))
def test_any_values_are_taken_or_refused_with_the_code(content):
    try:
        sidecar = parsed(yaml.safe_dump(content))
    except MeshError as error:
        code = error.code
        sidecar = Sidecar()
    else:
        code = ErrorCode.MESH_SIDECAR_INVALID
    assert code == ErrorCode.MESH_SIDECAR_INVALID
    assert sidecar.unit is None or sidecar.unit in UNITS
    for value in (sidecar.mass, sidecar.density):
        assert value is None or 0 < value <= 30_000


def test_symmetries_of_all_kinds() -> None:
    text = b"""
    symmetries:
      - {axis: [0, 0, 2], order: any, point: [0.01, 0, 0]}
      - {rotation_xyzw: [1, 0, 0, 0], point: [0.01, 0, 0.05]}
    """
    symmetry = parse_sidecar(text, "part.yaml").symmetry
    assert symmetry is not None
    assert len(symmetry.matrices) == 2
    flip = symmetry.matrices[1]
    np.testing.assert_allclose(flip[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-9)
    np.testing.assert_allclose(flip[:3, 3], [0.0, 0.0, 0.1], atol=1e-9)
    assert symmetry.axis is not None
    np.testing.assert_allclose(symmetry.axis.point, [0.01, 0.0, 0.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("symmetries: []", "a list of 1 to 8"),
        ("symmetries: any", "a list of 1 to 8"),
        ("symmetries: [{axis: [0, 0, 1]}]", "axis and order, or rotation_xyzw"),
        ("symmetries: [{axis: [0, 0, 0], order: 2}]", "give a direction"),
        ("symmetries: [{axis: [0, 0, 1], order: 1}]", "from 2 to 360, or any"),
        ("symmetries: [{axis: [0, 0, 1], order: 2.0}]", "from 2 to 360, or any"),
        ("symmetries: [{rotation_xyzw: [0, 0, 0, 1]}]", "turns by nothing"),
        ("symmetries: [{rotation_xyzw: [0, 0, 1]}]", "of length 1"),
        ("symmetries: [{axis: [0, 0, 1], order: any}, {axis: [1, 0, 0], order: any}]", "no body"),
    ],
)
def test_symmetries_that_cannot_be_are_refused(text: str, said: str) -> None:
    with pytest.raises(MeshError, match=said) as caught:
        parse_sidecar(text.encode(), "part.yaml")
    assert caught.value.code == ErrorCode.MESH_SIDECAR_INVALID

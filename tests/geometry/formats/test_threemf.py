"""3MF: models of before version 1.0, and what is said of extensions that are not read."""

from __future__ import annotations

import mesh_dialects as d
import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.threemf import read_3mf

OBJECT = f'<object id="1" type="model" name="part">{d.mesh_xml(d.BOX)}</object>'
ITEM = '<item objectid="1"/>'


def test_a_model_of_the_name_space_before_version_1_0_is_read():
    """Its shapes are those of today; it was refused as having no faces."""
    model = d.model_xml(OBJECT, ITEM)
    now = read_3mf(d.threemf(model), "box.3mf", 1000)
    old = model.replace(d.CORE, "http://schemas.microsoft.com/3dmanufacturing/2013/01")
    before = read_3mf(d.threemf(old), "box.3mf", 1000)
    np.testing.assert_array_equal(before.vertices, now.vertices)
    np.testing.assert_array_equal(before.faces, now.faces)
    assert before.own_unit == "millimeter"


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("http://schemas.microsoft.com/3dmanufacturing/slice/2015/07", "the extension 'slice'"),
        ("http://schemas.3mf.io/3dmanufacturing/volumetric/2022/01", "the extension 'volumetric'"),
    ],
)
def test_an_extension_is_refused_by_its_name_with_a_cure_that_helps(address, words):
    more = f' xmlns:s="{address}" requiredextensions="s"'
    with pytest.raises(MeshError) as caught:
        read_3mf(d.threemf(d.model_xml(OBJECT, ITEM, more=more)), "box.3mf", 1000)
    assert caught.value.code == ErrorCode.MESH_FORMAT_NOT_SUPPORTED
    assert words in caught.value.message
    assert "Export the finished shape, such as STL." in caught.value.message
    assert "Export it again" not in caught.value.message


def test_what_is_wrong_with_the_xml_is_said():
    model = d.model_xml(OBJECT, ITEM).replace("<build>", "<m:colour/><build>")
    with pytest.raises(MeshError, match=r"line 1: unbound prefix"):
        read_3mf(d.threemf(model), "box.3mf", 1000)

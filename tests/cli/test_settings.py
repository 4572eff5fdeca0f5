from __future__ import annotations

from gpis_grasp_planner.cli.options import setting_classes
from gpis_grasp_planner.settings import describe


def test_every_setting_is_there_with_default_bounds_and_meaning(gpis_grasp) -> None:
    answer = gpis_grasp("settings")
    assert answer.code == 0
    lines = answer.out.splitlines()
    count = 0
    for group, settings in setting_classes().items():
        assert f"## {group}" in lines
        for info in describe(settings):
            [line] = [row for row in lines if row.startswith(f"| `{group}.{info.name}` |")]
            assert f"| `{info.default}` | {info.range_text()} | {info.description} |" in line
            count += 1
    assert count > 20

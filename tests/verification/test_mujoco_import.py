"""MuJoCo is imported without its windows, and with what somebody else asked for left alone."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

PROGRAM = """
import os, subprocess, sys

class NoProgram:
    def __init__(self, *args, **_):
        raise AssertionError(f"a program is started: {args}")

subprocess.Popen = NoProgram
import gpis_grasp_planner.verification.mujoco.engine
import mujoco
print("glfw" in sys.modules, os.environ.get("MUJOCO_GL"), mujoco.MjModel.__name__)
"""


@pytest.mark.parametrize("asked_for", [None, "off"])
def test_the_import_starts_no_program_and_leaves_the_environment_as_it_was(asked_for):
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"}
    if asked_for is not None:
        environment["MUJOCO_GL"] = asked_for
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["False", str(asked_for), "MjModel"], done.stderr

"""MuJoCo as an engine, without its windows.

While it is imported, MuJoCo's OpenGL part has GLFW start programs that ask its libraries for their
version: two fifths of the import's time, and a traceback on the terminal where the process ends
meanwhile. Nothing here draws with MuJoCo. Who does so in the same process imports it before, or
says by MUJOCO_GL what to draw with.
"""

import os

_UNSET = "MUJOCO_GL" not in os.environ
if _UNSET:
    os.environ["MUJOCO_GL"] = "disabled"
try:
    import mujoco  # noqa: F401
finally:
    if _UNSET:
        del os.environ["MUJOCO_GL"]

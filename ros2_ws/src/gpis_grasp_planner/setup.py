"""Build script of the ROS package (ament_python); plain pip installs it as well."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "gpis_grasp_planner"
HAND_FILES = sorted(
    p for p in Path(NAME, "hand/models").rglob("*") if p.suffix in {".urdf", ".stl"}
)
SHARED = ("config", "foxglove", "launch", "policies", "rviz")
# The one place of the version; tests/test_version.py compares the files that cannot read it.
[VERSION] = re.findall(r'^__version__ = "(.+)"$', Path(NAME, "__init__.py").read_text(), re.M)

setup(
    name=NAME,
    version=VERSION,
    description="Grasp planning with Gaussian process implicit surfaces, as a ROS 2 service",
    license="Apache-2.0",
    maintainer="GPIS grasp planner developers",
    maintainer_email="gpis-grasp-planner@example.com",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    # Hand models, shipped parts and their settings lie beside the modules that read them.
    package_data={
        NAME: ["py.typed", *(f"**/*.{kind}" for kind in ("urdf", "yaml", "stl", "obj", "ply"))]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        # For those who want them; nothing needs them.
        *(
            (f"share/{NAME}/{folder}", [str(p) for p in sorted(Path(folder).iterdir())])
            for folder in SHARED
        ),
        # For other machines' package://gpis_grasp_planner/hand/models/<hand>/meshes/...
        *((f"share/{p.parent}", [str(p)]) for p in HAND_FILES),
    ],
    zip_safe=False,
    python_requires=">=3.11",
    # The one list of what the planner needs; `make lock` pins it. ROS packages are in package.xml.
    install_requires=[
        "argcomplete",  # shell completion of gpis-grasp
        "fast-simplification",  # large meshes
        "llvmlite",  # numba's: vectors of the inner loop
        "numba",  # inner loop of the search
        "numpy",
        "pybullet",  # physics
        "PyYAML",
        "rich",
        "scipy",
        "threadpoolctl",  # one thread for BLAS in programs that loaded numpy before
    ],
    extras_require={
        "step": ["cascadio"],  # STEP files
        "cloud": ["open3d"],  # point clouds in place of a mesh
        "pictures": ["matplotlib", "pillow"],  # --picture, reports
        "mujoco": ["mujoco"],  # verification.engine
        "arm": ["coal", "eaik"],  # arm.model
        "view": ["viser"],  # gpis-grasp view
        "cluster": ["distributed"],  # plan-all --scheduler
    },
    entry_points={
        "console_scripts": [
            f"grasp_planner_node = {NAME}.ros.node:main",
            f"grasp_planner_lifecycle_node = {NAME}.ros.node:main_lifecycle",
            f"gpis-grasp = {NAME}.cli.main:main",
        ]
    },
)

"""The shipped parts: generator modules, and the meshes they made in ``meshes/``."""

"""Loads the simulator's library of the mujoco package, before the native module asks for it."""

import ctypes
import importlib.util
import pathlib
import sys

MUJOCO = "3.17.0"


def load():
    """Loads the library; once it is there, the native module finds it by its name.

    Raises ImportError that says which version is needed and which is there.
    """
    hint = f"hint: pip install mujoco=={MUJOCO}"
    spec = importlib.util.find_spec("mujoco")
    if spec is None or spec.origin is None:
        raise ImportError(f"genmanip needs the simulator of the package mujoco, version {MUJOCO}, which is missing\n{hint}")
    folder = pathlib.Path(spec.origin).parent
    name = f"libmujoco.{MUJOCO}.dylib" if sys.platform == "darwin" else f"libmujoco.so.{MUJOCO}"
    if not (folder / name).is_file():
        found = ", ".join(sorted(path.name for path in folder.glob("libmujoco*"))) or "no library"
        raise ImportError(f"genmanip needs MuJoCo {MUJOCO}, found {found} in {folder}\n{hint}")
    library = ctypes.CDLL(str(folder / name))
    library.mj_versionString.restype = ctypes.c_char_p
    version = library.mj_versionString().decode()
    if version != MUJOCO:
        raise ImportError(f"genmanip needs MuJoCo {MUJOCO}, but {folder / name} is {version}\n{hint}")

"""Adds the packages, and the firmware as a module, to what pyproject.toml describes."""

from setuptools import find_namespace_packages, setup
from setuptools.command.build_ext import build_ext


class BuildExtension(build_ext):
    """Sources of the firmware lie outside this folder: setuptools cannot list them, but can compile them."""

    def get_source_files(self) -> list[str]:
        return []


setup(
    packages=[*find_namespace_packages(include=["ribbonhil*"]), "ribbonhil.checks"],
    cmdclass={"build_ext": BuildExtension},
    cffi_modules=["ribbonhil/firmware_build.py:ffibuilder"],
)

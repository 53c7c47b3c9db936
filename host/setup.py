"""Adds the C solver to what pyproject.toml describes."""

from setuptools import setup

setup(cffi_modules=["ribbonhost/native/build.py:ffibuilder"])

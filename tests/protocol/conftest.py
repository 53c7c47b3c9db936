"""Lets the tests of the protocol import their helpers and the generator."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / "protocol")]

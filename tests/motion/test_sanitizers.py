"""The C motion estimator under the address and undefined-behaviour sanitizers."""

import os
import subprocess
from pathlib import Path

from ribbonhost.native.build import HERE, SOURCES

FLAGS = (
    "-std=c11",
    "-g",
    "-O1",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
)


def test_motion_estimator_is_clean_under_sanitizers(tmp_path: Path) -> None:
    sources = [HERE / name for name in SOURCES if name.startswith("motion_")]
    program = tmp_path / "drive_motion"
    subprocess.run(
        [
            os.environ.get("CC", "cc"),
            *FLAGS,
            f"-I{HERE}",
            Path(__file__).with_name("drive_motion.c"),
            *sources,
            "-lm",
            "-o",
            program,
        ],
        check=True,
    )
    done = subprocess.run([program], capture_output=True, text=True, timeout=100, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")

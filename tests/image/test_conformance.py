"""The conformance suite on the image, in real time: the groups that a port has the largest part in."""

import subprocess
import sys

from image.programs import built

GROUPS = ("info", "calibration", "dfu")


def test_image_keeps_the_rules_of_the_protocol() -> None:
    url = f"emulated://wing/1?ribbons=1&image={built()}"
    chosen = [argument for group in GROUPS for argument in ("--only", group)]
    program = [sys.executable, "-c", "from ribbonhil.cli import main; main()"]
    result = subprocess.run(
        [*program, "conformance", url, *chosen, "--dfu"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    print(result.stdout)
    assert (result.returncode, result.stderr) == (0, "")
    assert "0 failed" in result.stdout
    assert "enter_dfu_leaves_the_firmware" in result.stdout

"""What `ribbonhil part-errors` prints."""

import json

import numpy as np

from ribbonhil.emulated_device import PARTS
from ribbonhil.part_errors import drawn_errors
from ribbonhil.part_ranges import MG_MPS2
from ribbonhil.rotations import Array


def show_part_errors(seed: int, ribbon: int, *, as_json: bool) -> None:
    """Prints the errors of a ribbon: a table of magnitudes, or all numbers as JSON."""
    errors = drawn_errors(seed, ribbon, PARTS)
    if as_json:
        print(json.dumps({"seed": seed, "ribbon": ribbon, **errors.to_dict()}))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"part errors {seed}, ribbon {ribbon}: the largest of the three axes")
    for heading in ("slot", "", "bias", "scale %", "cross %", "mounting deg", "along mm"):
        table.add_column(heading, justify="right")
    for slot in range(len(PARTS)):
        is_accelerometer = slot % 2 == 0
        kind, unit, in_unit = ("acc", "mg", MG_MPS2) if is_accelerometer else ("mag", "uT", 1.0)
        table.add_row(
            str(slot),
            kind,
            f"{_largest(errors.total_bias[slot]) / in_unit:+.1f} {unit}",
            f"{100 * _largest(errors.scale[slot]):+.2f}",
            f"{100 * _largest(errors.cross_axis[slot]):+.2f}",
            f"{np.degrees(_largest(errors.mounting_rad[slot])):+.2f}",
            f"{1e3 * errors.offset_m[slot]:+.2f}",
        )
    Console().print(table)


def _largest(values: Array) -> float:
    return float(values[np.argmax(np.abs(values))])

"""How far parts off the shelf, and their assembly on a ribbon, are from ideal: the one place that says so.

Every figure is one standard deviation. Of a data sheet's figures a typical one counts as one standard
deviation (ST's own definition of TyOff), a largest one as three. Where a sheet gives none, that is said.
"""

from dataclasses import dataclass
from math import radians

from ribbonhil._firmware import lib

MG_MPS2 = 9.80665e-3
CUT_OFF_SIGMAS = 3.0  # nothing is drawn from further out: such parts fail the maker's own test


@dataclass(frozen=True)
class PartRange:
    """Of one kind of part; accelerometers in m/s^2, magnetometers in uT.

    bias, bias_per_c: of the reading without input, an axis. scale, scale_per_c: relative gain, an axis.
    cross_axis: what a pair of axes hears of one another, relative. alignment_rad: of the axes in the package,
    a component of the rotation vector.
    """

    bias: float
    bias_per_c: float
    scale: float
    scale_per_c: float
    cross_axis: float
    alignment_rad: float = 0.0


@dataclass(frozen=True)
class AssemblyRange:
    """Of how parts sit on a ribbon.

    mounting_rad: of a package against its node, a component of the rotation vector: reflow and the lamination
        of the flexible circuit. placement_m: of a package along the ribbon. pitch: relative, common to the
        ribbon: the dimensional stability of polyimide. hard_iron_ut, soft_iron: what magnetised and
        magnetisable solder, leads and batteries beside a magnetometer add to the field, an axis, and an
        element of the symmetric matrix.
    """

    mounting_rad: float = radians(1.0)
    placement_m: float = 0.1e-3
    pitch: float = 1e-3
    hard_iron_ut: float = 12.0
    soft_iron: float = 0.01


RANGES: dict[int, PartRange] = {
    # LIS2DW12 data sheet, table "Mechanical characteristics": TyOff +-20 mg, TCOff +-0.2 mg/C,
    # TCSo 0.01 %/C. It gives no tolerance of sensitivity and no cross-axis figure: of the order of what MEMS
    # accelerometers of other makers state.
    lib.WIRE_PART_LIS2DW12: PartRange(
        bias=20 * MG_MPS2,
        bias_per_c=0.2 * MG_MPS2,
        scale=0.015,
        scale_per_c=1e-4,
        cross_axis=0.01,
    ),
    # MMC5983MA data sheet, table "Specifications": sensitivity within 5 %, its change over temperature within
    # 3 % up to 80 C away, alignment 1 degree typical, transverse sensitivity 2 % typical. SET and RESET
    # cancel the null field output; what is left of it is of the order of the noise.
    lib.WIRE_PART_MMC5983MA: PartRange(
        bias=0.1,
        bias_per_c=0.0,
        scale=0.05 / 3,
        scale_per_c=0.03 / 80 / 3,
        cross_axis=0.02,
        alignment_rad=radians(1.0),
    ),
    # HMC5983 data sheet, table "Specifications": sensitivity tolerance +-5 %, cross-axis sensitivity 0.2 %.
    # Its residual offset and the drift left after its compensation are not given: as of the other part, and a
    # tenth of the 0.3 %/C that an uncompensated bridge has.
    lib.WIRE_PART_HMC5983: PartRange(
        bias=0.1,
        bias_per_c=0.0,
        scale=0.05 / 3,
        scale_per_c=3e-4,
        cross_axis=0.002,
    ),
}
ASSEMBLY = AssemblyRange()

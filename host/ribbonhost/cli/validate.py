"""`ribbonhost validate`: a recording against an optical system, or against the emulator's truth."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

from ribbonhost.cli.collect import reconstructed
from ribbonhost.cli.recording_options import ValidateOptions
from ribbonhost.errors import RibbonError, UsageError
from ribbonhost.validate.comparison import Comparison, compare
from ribbonhost.validate.report import facts_of, write_report
from ribbonhost.validate.truth import read_truth


def run_validate(paths: Sequence[Path], truth: Path, options: ValidateOptions) -> None:
    """Says how far off the recording is. Raises ValidationError, RecordingError, UsageError."""
    report = options.report
    if report is not None:
        if report.suffix.lower() not in (".html", ".htm"):
            raise UsageError(f"--report {report}: the ending must be .html")
        if report.exists() and not options.force:
            raise UsageError(f"{report} is there already: give another name, or --force to replace it")
    animation, replay = reconstructed(paths, options)
    layout, place = replay.arrangement.layout, replay.arrangement.places[0]
    _, ribbons, nodes, _ = animation.node_m.shape
    if layout is None and ribbons > 1:
        raise UsageError("ribbons that make no comb have no common frame: record them with --comb FILE")
    comparison = compare(
        animation.t_s,
        animation.node_m,
        read_truth(truth, animation.names, nodes),
        names=animation.names,
        length_m=layout.length_m if layout else (2 * nodes - 1) * place.pitch_m,
        is_comb=layout is not None,
        offset_s=options.offset_s,
        max_offset_s=options.max_offset_s,
    )
    written: list[Path] = []
    if report is not None:
        try:
            written = write_report(comparison, report, f"{paths[0].name} against {truth.name}")
        except OSError as error:
            raise RibbonError(f"{report} cannot be written: {error.strerror}") from error
    if options.json:
        print(json.dumps({"validation": _as_json(comparison, written)}))
        return
    for name, value in facts_of(comparison).items():
        print(f"{name + ':':26}{value}")
    for name, row in zip(comparison.names, comparison.node_mean_m * 1e3, strict=True):
        shown = " ".join("   -" if math.isnan(x) else f"{x:4.2f}" for x in row)
        print(f"{name + ', mm:':26}{shown}")
    for path in written:
        print(path)


def _as_json(comparison: Comparison, written: Sequence[Path]) -> dict[str, object]:
    mean, low, high = comparison.error_range()
    alignment = comparison.alignment
    return {
        "error_percent": {"mean": round(mean, 5), "min": round(low, 5), "max": round(high, 5)},
        "frames": int((comparison.error_percent == comparison.error_percent).sum()),
        "offset_s": alignment.offset_s,
        "offset_sigma_s": alignment.offset_sigma_s,
        "rotation": alignment.rotation.tolist(),
        "rotation_deg": comparison.rotation_deg,
        "translation_m": alignment.translation_m.tolist(),
        "rms_m": alignment.rms_m,
        "node_mean_m": [
            [None if math.isnan(x) else round(x, 7) for x in row] for row in comparison.node_mean_m.tolist()
        ],
        "ribbons": list(comparison.names),
        "files": [str(path) for path in written],
    }

"""`ribbonhost export`: the moving curves and surface of a recording as a file of another tool."""

import json
from collections.abc import Sequence
from pathlib import Path

from ribbonhost.cli.collect import reconstructed
from ribbonhost.cli.progress import progress_bar
from ribbonhost.cli.recording_options import ExportOptions
from ribbonhost.errors import RibbonError, UsageError
from ribbonhost.export import FORMATS, Options, export

WITHOUT_SURFACE = (".csv", ".parquet", ".bvh")


def run_export(paths: Sequence[Path], output: Path, options: ExportOptions) -> None:
    """Writes the file and says what is in it. Raises UsageError, RecordingError, MissingExtraError."""
    suffix = output.suffix.lower()
    if suffix not in FORMATS:
        raise UsageError(f'"{output.name}": the ending must be one of {" ".join(FORMATS)}')
    if options.up not in ("z", "y"):
        raise UsageError(f"--up {options.up} is not z or y")
    if output.exists() and not options.force:
        raise UsageError(f"{output} is there already: give another name, or --force to replace it")
    if not output.parent.is_dir():
        raise UsageError(f"{output} cannot be written: there is no folder {output.parent}")
    if options.start_s is not None and options.end_s is not None and options.end_s < options.start_s:
        raise UsageError(f"--to {options.end_s:g} is before --from {options.start_s:g}")
    animation, replay = reconstructed(
        paths, options, rate_hz=options.rate_hz, with_surface=suffix not in WITHOUT_SURFACE
    )
    with progress_bar(f"write {suffix}") as progress:
        try:
            written = export(
                animation,
                output,
                Options(up="y" if options.up == "y" else "z", scale=options.scale),
                lambda done, total: progress(done / total),
            )
        except OSError as error:
            raise RibbonError(f"{output} cannot be written: {error.strerror or error}") from error
    frames, ribbons, nodes, _ = animation.node_m.shape
    facts = {
        "files": [str(path) for path in written],
        "frames": frames,
        "ribbons": ribbons,
        "nodes": nodes,
        "t_start_s": round(float(animation.t_s[0]), 6),
        "t_end_s": round(float(animation.t_s[-1]), 6),
        "method": replay.method,
        "motion": replay.motion,
        "invalid_nodes": int((~animation.valid).sum()),
        "damaged": replay.damaged,
        "bytes": sum(path.stat().st_size for path in written),
    }
    if options.json:
        print(json.dumps({"exported": facts}))
        return
    name = str(written[0]) if len(written) == 1 else f"{written[0]} to {written[-1].name}"
    print(
        f"{name}: {frames} frames of {ribbons} ribbons with {nodes} nodes each, "
        f"{animation.t_s[0]:.2f} to {animation.t_s[-1]:.2f} s, method {replay.method}, motion {replay.motion}"
    )
    if replay.damaged:
        print(f"{replay.damaged} damaged pieces of the recording were left out")

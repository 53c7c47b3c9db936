"""Figures of the benchmark as plain tables for a terminal."""

from typing import Any


def table(head: list[str], rows: list[list[str]]) -> str:
    """Columns as wide as they need to be, the first to the left, the others to the right."""
    lines = [head, *rows]
    width = [max(len(line[i]) for line in lines) for i in range(len(head))]
    text = [
        "  ".join(
            cell.ljust(w) if i == 0 else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(line, width, strict=True))
        )
        for line in lines
    ]
    return "\n".join([text[0], "  ".join("-" * w for w in width), *text[1:]])


def spread(figures: dict[str, float]) -> str:
    """mean [min, max]"""
    return f"{figures['mean']:.4f} [{figures['min']:.4f}, {figures['max']:.4f}]"


def accuracy_tables(result: dict[str, Any]) -> str:
    """What measure_accuracy found."""
    scenes = result["scenes"]
    parts = [
        f"E, percent of the ribbon's length: mean [min, max] over {result['frames']} frames of a whole comb."
    ]
    for kind, meaning in result["data"].items():
        methods = next(iter(scenes.values()))["error_percent"][kind]
        rows = [
            [method, *(spread(scene["error_percent"][kind][method]) for scene in scenes.values())]
            for method in methods
        ]
        parts.append(f"{kind}: {meaning}\n" + table(["method", *scenes], rows))
    rows = [
        [
            f"{name}, {twist} twist",
            f"{figures['mean_mm']:.3f}",
            f"{figures['max_mm']:.2f}",
            f"{figures['seam_deg']:.1e}",
            f"{figures['lambda_min']:.3f}",
            f"{figures['lambda_held']} of {figures['lambda_count']}",
        ]
        for name, scene in scenes.items()
        for twist, figures in scene["surface"].items()
    ]
    head = ["scene", "mean mm", "max mm", "seams deg", "least lambda", "held"]
    parts.append(
        "Surface, exact orientations: distance of the vertices from the true surface\n" + table(head, rows)
    )
    covered = {name: scene["coverage"] for name, scene in scenes.items()}
    covered["straight ribbon"] = result["coverage_straight"]
    rows = [[name, f"{found['percent']:.1f}", str(found["runs"])] for name, found in covered.items()]
    parts.append(
        "Uncertainty: nodes inside their 95 % region, percent\n" + table(["scene", "inside", "runs"], rows)
    )
    return "\n\n".join(parts)


def speed_tables(result: dict[str, Any]) -> str:
    """What measure_speed found."""
    frame, comb, batch = result["frame_of_16_nodes_s"], result["comb_frame_s"], result["batch"]
    hermite, motion = frame["hermite"], result["motion_sample_s"]
    parts = [
        "One ribbon's frame of 16 nodes, tangents to positions\n"
        + table(
            ["method", "time", "of hermite"],
            [[name, duration(s), f"{s / hermite:,.1f}"] for name, s in frame.items()],
        ),
        "Whole comb frame from Python: 6 ribbons, transversals, 60 patches of 8 x 8 with normals\n"
        + table(
            ["by", "time", "of native"],
            [
                [name, duration(comb[name]), f"{comb[name] / comb['native']:,.0f}"]
                for name in ("native", "numpy_reference")
            ],
        ),
        "One live sample of the motion estimator\n"
        + table(
            ["by", "time", "of native"],
            [
                [name, duration(motion[name]), f"{motion[name] / motion['native']:,.0f}"]
                for name in ("native", "numpy_reference")
            ],
        ),
        f"Batch of {batch['frames']:,} frames from Python; a copy of it: {duration(batch['copy_s'])}\n"
        + table(
            ["method", "one thread", "two", "ratio", "processor, one", "two"],
            [
                [
                    method,
                    duration(batch[method]["one_thread_s"]),
                    duration(batch[method]["two_threads_s"]),
                    f"{batch[method]['ratio']:.2f}",
                    duration(batch[method]["one_thread_processor_s"]),
                    duration(batch[method]["two_threads_processor_s"]),
                ]
                for method in ("hermite", "spline")
            ],
        ),
    ]
    growth = result["growth"]
    rows = [
        [n, *(f"{1e9 * times[method] / int(n):.1f}" for method in ("hermite", "spline"))]
        for n, times in growth["nodes"].items()
    ]
    parts.append("Growth with nodes: ns a node of one ribbon\n" + table(["nodes", "hermite", "spline"], rows))
    rows = [[r, duration(s), duration(s / int(r))] for r, s in growth["ribbons_of_16_nodes"].items()]
    parts.append(
        "Growth with ribbons of 16 nodes: whole comb frame\n" + table(["ribbons", "time", "a ribbon"], rows)
    )
    rows = [[n, duration(s), duration(s / int(n))] for n, s in growth["nodes_of_5_ribbons"].items()]
    parts.append(
        "Growth with nodes of 5 ribbons: whole comb frame\n" + table(["nodes", "time", "a node"], rows)
    )
    return "\n\n".join(parts)


def duration(seconds: float) -> str:
    """Three digits and a unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"

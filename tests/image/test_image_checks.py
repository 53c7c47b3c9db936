"""The checks in the firmware's build: each of them can fail, and says why."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "firmware/tools"))

import image_check
import stack_usage


def graph(**functions: tuple[int, list[str]]) -> stack_usage.CallGraph:
    """Functions with their frames and whom they call."""
    return stack_usage.CallGraph(
        {name: size for name, (size, _) in functions.items()},
        {name: set(callees) for name, (_, callees) in functions.items()},
    )


def test_call_graph_is_read_from_what_gcc_writes(tmp_path: Path) -> None:
    path = tmp_path / "a.ci"
    path.write_text(
        'graph: { title: "a.c"\n'
        'node: { title: "top" label: "top\\na.c:1:6\\n24 bytes (static)\\n0 dynamic objects" }\n'
        'node: { title: "a.c:leaf" label: "leaf\\na.c:9:6\\n8 bytes (static)\\n0 dynamic objects" }\n'
        'node: { title: "memcpy" label: "memcpy\\n<built-in>" shape : ellipse }\n'
        'edge: { sourcename: "top" targetname: "a.c:leaf" label: "a.c:3:3" }\n'
        'edge: { sourcename: "a.c:leaf" targetname: "memcpy" label: "a.c:10:3" }\n}\n'
    )
    read = stack_usage.read_call_graph([path])
    assert stack_usage.deepest(read, "top") == (24 + 8 + 32, ["top", "a.c:leaf", "memcpy"])


def test_frame_of_unbounded_size_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ci"
    path.write_text('node: { title: "f" label: "f\\na.c:1:6\\n24 bytes (dynamic)\\n1 dynamic objects" }\n')
    with pytest.raises(stack_usage.StackError, match="f has a frame of unbounded size"):
        stack_usage.read_call_graph([path])


def test_deepest_chain_counts_not_the_longest() -> None:
    read = graph(top=(8, ["long", "deep"]), long=(8, ["longer"]), longer=(8, []), deep=(100, []))
    assert stack_usage.deepest(read, "top") == (108, ["top", "deep"])


def test_recursion_has_no_worst_case() -> None:
    with pytest.raises(stack_usage.StackError, match="recursion: ping -> pong -> ping"):
        stack_usage.deepest(graph(ping=(8, ["pong"]), pong=(8, ["ping"])), "ping")


def test_function_of_unknown_stack_is_refused() -> None:
    with pytest.raises(stack_usage.StackError, match="the stack of mystery, called by top, is not known"):
        stack_usage.deepest(graph(top=(8, ["mystery"])), "top")


def test_call_through_a_pointer_must_be_declared() -> None:
    read = graph(top=(8, [stack_usage.INDIRECT]), target=(50, []))
    with pytest.raises(stack_usage.StackError, match="top calls through a pointer"):
        stack_usage.add_indirect_calls(read, {})
    stack_usage.add_indirect_calls(read, {"top": {"target"}})
    assert stack_usage.deepest(read, "top")[0] == 58


def test_declared_call_must_exist() -> None:
    with pytest.raises(stack_usage.StackError, match=r"top of indirect_calls\.txt do not call"):
        stack_usage.add_indirect_calls(graph(top=(8, []), target=(50, [])), {"top": {"target"}})


def test_worst_case_stacks_an_interrupt_and_the_non_maskable_one_on_top() -> None:
    read = graph(main=(100, []), irq_a=(10, []), irq_b=(20, []), nmi=(4, []), fault=(8, []))
    worst, chain = stack_usage.worst_case(read, "main", ["irq_a", "irq_b"], "nmi", "fault")
    assert worst == 100 + 20 + 4 + 2 * stack_usage.EXCEPTION_FRAME_BYTES
    assert chain == ["main"]


@pytest.mark.parametrize(
    ("sections", "complaint"),
    [
        ({".vectors": 400, ".text": 65_000, ".data": 200}, "65600 bytes of flash"),
        ({".text": 100, ".stack": 8192, ".bss": 24_577}, "32769 bytes of static RAM"),
    ],
)
def test_image_beyond_its_budget_is_refused(sections: dict[str, int], complaint: str) -> None:
    with pytest.raises(image_check.ImageError, match=complaint):
        image_check.check_sizes(sections)


def test_sizes_are_read_from_what_size_writes() -> None:
    output = "ribbon.elf :\nsection  size  addr\n.text   12000   134217728\n.bss       300   536870912\n"
    assert image_check.section_bytes(output) == {".text": 12000, ".bss": 300}


@pytest.mark.parametrize(
    ("symbol", "what"),
    [
        ("malloc", "memory allocation"),
        ("_sbrk", "memory allocation"),
        ("_free_r", "memory allocation"),
        ("printf", "formatted output"),
        ("_vfprintf_r", "formatted output"),
        ("sniprintf", "formatted output"),
        ("__aeabi_dmul", "double precision"),
        ("__aeabi_f2d", "double precision"),
        ("__aeabi_i2d", "double precision"),
        ("__muldf3", "double precision"),
        ("sinf", "trigonometry"),
        ("__ieee754_atan2f", "trigonometry"),
        ("acosf", "trigonometry"),
    ],
)
def test_banned_function_is_found(symbol: str, what: str) -> None:
    with pytest.raises(image_check.ImageError, match=f"{what}.*{symbol}"):
        image_check.check_symbols(["main", symbol])


def test_harmless_names_are_not_mistaken_for_banned_ones() -> None:
    image_check.check_symbols(["main", "sine_table", "free_slots", "output_printed", "__aeabi_fmul", "since"])

"""What `ribbonhil serve` does: a comb, a port for each ribbon, a comb file that names them."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.device import open_device
from ribbonhost.wire import CommandCode

from ribbonhil.emulator import EmulatedComb, open_line
from ribbonhil.fault_port import FaultPort
from ribbonhil.faults import Fault, FaultKind
from ribbonhil.serve import Endpoint, PtyEndpoint, TcpEndpoint, serve, to_line


@dataclass(frozen=True)
class ServeOptions:
    """What was asked for on the command line; port is that of the first ribbon, 0 for any.

    faults_port: where faults are taken on request; None: nowhere.
    """

    scene: str
    ribbons: int
    rate_hz: int
    seed: int
    period_s: float | None
    noise: float
    part_errors: int | None
    warming_c: float
    disturb: str
    image: str
    board: str
    use_tcp: bool
    address: str
    port: int
    faults_port: int | None
    seconds: float | None


def run_serve(
    options: ServeOptions,
    on_start: Callable[[str, list[str], str], None],
    on_change: Callable[[int, bool, int], None],
) -> None:
    """Serves until interrupted.

    on_start is called once with the text of the comb file, the URLs, the reference's first, and the address
    that takes faults, empty if there is none; on_change as by serve(). Raises UsageError or SceneError for
    what cannot be served.
    """
    with ExitStack() as stack:
        comb = stack.enter_context(
            EmulatedComb(
                options.scene,
                options.ribbons,
                options.seed,
                options.period_s,
                options.noise,
                image=options.image,
                board=options.board,
                part_errors=options.part_errors,
                warming_c=options.warming_c,
                disturb=options.disturb,
            )
        )
        for url in comb.urls:
            set_rate(url, options.rate_hz)
        lines = [open_line(comb.spec, index) for index in range(options.ribbons + 1)]
        for line in lines:
            stack.callback(line.close)
        endpoints: list[Endpoint] = []
        for index, line in enumerate(lines):
            if options.use_tcp:
                port = options.port + index if options.port else 0
                endpoints.append(TcpEndpoint(options.address, port, to_line(line)))
            else:
                endpoints.append(PtyEndpoint(to_line(line)))
        others = []
        if options.faults_port is not None:
            others.append(FaultPort(options.faults_port, fault_maker(comb)))
        address = others[0].address if others else ""
        on_start(comb_text(comb), [endpoint.url for endpoint in endpoints], address)
        serve(lines, endpoints, on_change, options.seconds, others)


def fault_maker(comb: EmulatedComb) -> Callable[[str, FaultKind, int, float], None]:
    """make(serial, kind, slot, seconds): a fault of one of these ribbons from now on."""

    def make(serial: str, kind: FaultKind, slot: int, seconds: float) -> None:
        if serial not in comb.serials:
            raise ValueError(f"there is no ribbon {serial} here")
        start_s = time.monotonic() - comb.start_host_s
        comb.add_fault(comb.serials.index(serial), Fault(kind, slot, start_s, start_s + seconds))

    return make


def comb_text(comb: EmulatedComb) -> str:
    """The comb file of an emulated comb."""
    reference, *others = comb.serials
    ribbons = tuple(CombRibbon(s, start_m) for s, start_m in zip(others, comb.layout_start_m, strict=True))
    return Comb(reference, comb.pitch_m, ribbons).to_toml()


def set_rate(url: str, rate_hz: int) -> None:
    """Tells a device how often to scan."""
    device = open_device(url)
    try:
        device.command(CommandCode.SET_RATE, rate_hz)
    finally:
        device.close()

"""The port's register header against ST's own description of the chip, which pyocd brings along."""

import re
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

HEADER = Path(__file__).resolve().parents[2] / "firmware/src/port/stm32f405/registers.h"
SVD = "STM32F41x.svd"  # the F405 is an F415 without cryptography

# What the header calls otherwise than the SVD file.
PERIPHERALS = {
    "SPI": "SPI1",
    "USART": "USART2",
    "DMA": "DMA1",
    "TIM": "TIM2",
    "ADC": "ADC1",
    "ADC_COMMON": "C_ADC",
}
REGISTERS = {("SYSCFG", "MEMRMP"): "MEMRM", ("DMA1", "SxCR"): "S6CR"}
WHOLE_REGISTER_FIELDS = {("ADC1", "SMPR1")}  # the SVD file does not tell its fields apart
NOT_OF_THE_CHIP = ("SYSTICK", "NVIC", "SCB")  # Arm's, not ST's: tried by exceptions.c on two models
NOT_REGISTERS = ("REGISTERS_H", "GPIO_BYTES", "SYSTEM_MEMORY", "UNIQUE_ID", "TEMPERATURE_", "ADC_CHANNEL_")


@dataclass
class Peripheral:
    """Address, and registers by name: offset and fields (first bit, width)."""

    address: int
    offsets: dict[str, int] = field(default_factory=dict)
    fields: dict[str, dict[str, tuple[int, int]]] = field(default_factory=dict)


@cache
def svd() -> tuple[dict[str, Peripheral], dict[str, int]]:
    """Peripherals, and interrupt numbers in lower case."""
    package = find_spec("pyocd")  # found, not imported: only its data is wanted
    assert package is not None
    assert package.origin is not None
    archive = zipfile.ZipFile(Path(package.origin).parent / "debug/svd/svd_data.zip")
    root = ET.fromstring(archive.read(SVD))
    elements = {p.findtext("name", ""): p for p in root.iter("peripheral")}
    peripherals = {}
    for name, element in elements.items():
        peripheral = Peripheral(int(element.findtext("baseAddress", ""), 16))
        described = elements[element.get("derivedFrom", name)]
        for register in described.iter("register"):
            register_name = register.findtext("name", "")
            peripheral.offsets[register_name] = int(register.findtext("addressOffset", ""), 0)
            peripheral.fields[register_name] = {
                f.findtext("name", ""): (int(f.findtext("bitOffset", "")), int(f.findtext("bitWidth", "")))
                for f in register.iter("field")
            }
        peripherals[name] = peripheral
    interrupts = {
        i.findtext("name", "").removesuffix("_IRQ").lower(): int(i.findtext("value", ""))
        for i in root.iter("interrupt")
    }
    return peripherals, interrupts


def structures(text: str) -> dict[str, list[tuple[str, int]]]:
    """Members of each struct with their offsets; a stream of the DMA is S6CR and so on."""
    found: dict[str, list[tuple[str, int]]] = {}
    for name, body in re.findall(r"struct (\w+)_registers \{(.*?)\};", text, re.DOTALL):
        members, offset = [], 0
        pattern = r"^\s*(volatile )?(uint32_t|uint8_t|struct (\w+)_registers) (\w+)(?:\[(\d+)\])?;"
        for _, kind, inner, member, count in re.findall(pattern, body, re.MULTILINE):
            size = {"uint32_t": 4, "uint8_t": 1}.get(kind, 0) or 4 * len(found[inner])
            for i in range(int(count or 1)):
                if inner:
                    members += [(f"{member}{i}{m}", offset + o) for m, o in found[inner]]
                elif not member.startswith("reserved"):
                    members.append((member, offset))
                offset += size
        found[name] = members
    return found


def defines(text: str) -> list[tuple[str, str]]:
    """(name, value) of the macros; a parameter counts as 1."""
    joined = text.replace("\\\n", " ")
    return [
        (name, re.sub(rf"\({parameter}\)", "1", value) if parameter else value)
        for name, _, parameter, value in re.findall(
            r"^#define (\w+)(\((\w+)\))?\s+(.+?)(?:\s*/\*.*)?$", joined, re.MULTILINE
        )
    ]


def instances(text: str) -> list[tuple[str, str, int]]:
    """(name, struct, address) of the peripherals of the chip."""
    pattern = r"^#define (\w+)\s+\(\(struct (\w+)_registers \*\)(0x[0-9A-F]+)u\)"
    return [
        (name, structure, int(address, 16))
        for name, structure, address in re.findall(pattern, text, re.MULTILINE)
        if name not in NOT_OF_THE_CHIP
    ]


def wrong_registers(text: str) -> list[str]:
    """Peripherals and registers of the header that are elsewhere in the SVD file."""
    peripherals, _ = svd()
    wrong = []
    for name, structure, address in instances(text):
        described = peripherals[PERIPHERALS.get(name, name)]
        if described.address != address:
            wrong.append(name)
        for register, offset in structures(text)[structure]:
            if described.offsets.get(REGISTERS.get((name, register), register)) != offset:
                wrong.append(f"{name}.{register}")
    return wrong


def field_bits(peripheral: str, register: str, name: str) -> int:
    """The bits of a field, which the SVD file may give one by one: SW0, SW1. 0 if there is none."""
    fields = svd()[0][peripheral].fields[register]
    parts = [bits for f, bits in fields.items() if f == name or re.fullmatch(rf"{name}\d+", f)]
    exact = [bits for f, bits in fields.items() if f == name]
    return sum(((1 << width) - 1) << first for first, width in exact or parts)


def wrong_bits(text: str) -> list[str]:
    """Macros PERIPHERAL_REGISTER_FIELD[_VALUE] that are not the bits of that field."""
    wrong = []
    names = [name for name, _, _ in instances(text)]
    prefixes = sorted({*PERIPHERALS, *names}, key=len, reverse=True)
    for macro, value_text in defines(text):
        if macro.startswith((*NOT_OF_THE_CHIP, *NOT_REGISTERS)) or macro in names:
            continue
        prefix = next((p for p in prefixes if macro.startswith(f"{p}_")), None)
        if prefix is None:
            wrong.append(macro)
            continue
        peripheral = PERIPHERALS.get(prefix, prefix)
        register, _, rest = macro.removeprefix(f"{prefix}_").partition("_")
        register = REGISTERS.get((peripheral, register), register)
        if register not in svd()[0][peripheral].fields:
            wrong.append(macro)
            continue
        value = eval(re.sub(r"\(uint32_t\)|(?<=\d)u\b|(?<=[\dA-F])u\b", "", value_text))
        words = rest.split("_")
        candidates = ["_".join(words[:n]) for n in range(len(words), 0, -1)]
        name = next((c for c in candidates if field_bits(peripheral, register, c)), "")
        bits = field_bits(peripheral, register, name) if name else 0
        if (peripheral, register) in WHOLE_REGISTER_FIELDS:
            right = True
        elif f"{macro}(" in text:
            right = value == bits & -bits
        elif rest in (name, f"{name}_MASK"):
            right = value == bits
        else:
            right = value & ~bits == 0 and bits != 0
        if not right:
            wrong.append(macro)
    return wrong


def test_registers_are_where_the_chip_has_them() -> None:
    assert len(instances(HEADER.read_text())) >= 14
    assert wrong_registers(HEADER.read_text()) == []


def test_bits_are_those_of_their_fields() -> None:
    assert wrong_bits(HEADER.read_text()) == []


def test_interrupt_numbers_are_those_of_the_chip() -> None:
    text = HEADER.read_text()
    numbers = {name.lower(): int(value) for name, value in re.findall(r"IRQ_(\w+) = (\d+)", text)}
    count = numbers.pop("count")
    _, interrupts = svd()
    assert numbers.items() <= interrupts.items()
    assert count > max(interrupts.values())


@pytest.mark.parametrize(
    ("right", "changed", "macro"),
    [
        ("RCC_CR_HSERDY        (1u << 17)", "RCC_CR_HSERDY        (1u << 18)", "RCC_CR_HSERDY"),
        ("RCC_CFGR_PPRE1_DIV4  (5u << 10)", "RCC_CFGR_PPRE1_DIV4  (5u << 13)", "RCC_CFGR_PPRE1_DIV4"),
        ("FLASH_CR_SNB(sector)  ((uint32_t)(sector) << 3)", "FLASH_CR_SNB(sector)  ((uint32_t)(sector) << 4)",
         "FLASH_CR_SNB"),
        ("USART_CR1_UE     (1u << 13)", "USART_CR1_XE     (1u << 13)", "USART_CR1_XE"),
    ],
)  # fmt: skip
def test_a_wrong_bit_is_found(right: str, changed: str, macro: str) -> None:
    text = HEADER.read_text()
    assert text.count(right) == 1
    assert wrong_bits(text.replace(right, changed)) == [macro]


def test_a_missing_register_is_found() -> None:
    text = HEADER.read_text().replace("    volatile uint32_t OTYPER;\n", "")
    assert "GPIOA.BSRR" in wrong_registers(text)

"""Spoil bytes in the ways in which files are spoilt: cut, garbled, edited, converted."""

import re

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
BAD_NUMBERS = [
    b"nan", b"-inf", b"1e400", b"1e38", b"-1", b"x", b"", b"1_0", b"0x1F", b"1,5", b"2147483648",
    b"99999999999999999999", b"9" * 5000, b"0", b"\xc3\xa9", b"1e-400", b"1.5", b"--1",
]  # fmt: skip


def mutate(data, generator):
    """Spoil a file once or twice, each time in a way drawn from the list below."""
    for _ in range(generator.integers(1, 3)):
        data = MUTATIONS[generator.integers(len(MUTATIONS))](data, generator)
    return data


def truncate(data, generator):
    return data[: generator.integers(len(data) + 1)]


def flip_bytes(data, generator):
    spoilt = bytearray(data)
    for _ in range(generator.integers(1, 20) if data else 0):
        spoilt[generator.integers(len(spoilt))] ^= 1 << int(generator.integers(8))
    return bytes(spoilt)


def insert_bytes(data, generator):
    at = generator.integers(len(data) + 1)
    noise = [b"\0" * 16, b"\xff\xfe", b"\n", b" ", b"\t", generator.bytes(32)]
    return data[:at] + noise[generator.integers(len(noise))] + data[at:]


def delete_bytes(data, generator):
    at = generator.integers(len(data) + 1)
    return data[:at] + data[at + generator.integers(1, 64) :]


def delete_lines(data, generator):
    lines = data.split(b"\n")
    at = generator.integers(len(lines))
    return b"\n".join(lines[:at] + lines[at + generator.integers(1, 60) :])


def duplicate_lines(data, generator):
    lines = data.split(b"\n")
    at = generator.integers(len(lines))
    return b"\n".join(lines[: at + generator.integers(1, 60)] + lines[at:])


def swap_lines(data, generator):
    lines = data.split(b"\n")
    i, j = generator.integers(len(lines), size=2)
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def replace_number(data, generator):
    """Put something else for one number; half of the time one of the first, which count things."""
    numbers = [match.span() for match in NUMBER.finditer(data)]
    if not numbers:
        return data
    few = len(numbers) if generator.integers(2) else min(len(numbers), 20)
    start, stop = numbers[generator.integers(few)]
    return data[:start] + BAD_NUMBERS[generator.integers(len(BAD_NUMBERS))] + data[stop:]


def convert_line_ends(data, generator):
    ends = [b"\r\n", b"\r", b"\n\n", b" \n", b"\x0b"]
    return data.replace(b"\n", ends[generator.integers(len(ends))])


def replace_all(data, generator):
    others = [b"", b"\n", b"\0" * 1000, generator.bytes(4096), b"\x89PNG\r\n", b"1\n" * 5000, b"{}"]
    return others[generator.integers(len(others))]


MUTATIONS = [
    truncate, flip_bytes, insert_bytes, delete_bytes, delete_lines, duplicate_lines, swap_lines,
    replace_number, convert_line_ends, replace_all,
]  # fmt: skip

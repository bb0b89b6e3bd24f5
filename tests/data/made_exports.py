"""Text exports of recording programs, made from the documented layouts with random contents."""

import codecs
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MUSCLES = ("ZYG_L", "Zyg R", "Levator links", "OOS_R", "Corrugator", "Mund (oben)")
RATES = (1000.0, 1111.111, 1259.2593, 1925.926, 2000.0, 2148.1481)
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "latin-1")


@dataclass(frozen=True)
class Made:
    """A file, and what a reader must find in it."""

    path: Path
    labels: list[str]
    rate: float
    volts: np.ndarray  #: (channels, samples) [V]
    others: list[str]  #: labels of signals that are no EMG
    resolution: float  #: largest rounding [V]
    units: dict[str, str]  #: of the mapping, if the file states none


def _signals(rng: np.random.Generator, count: int, rate: float) -> np.ndarray:
    n = int(rng.uniform(0.6, 1.5) * rate)
    envelope = 0.2 + np.exp(-(((np.arange(n) / n - 0.5) / 0.1) ** 2))
    return 5e-5 * envelope * rng.standard_normal((count, n))


def _numbers(values: np.ndarray, decimal: str, form: str = ".9g") -> list[str]:
    return [format(v, form).replace(".", decimal) for v in values]


def _written(path: Path, rng: np.random.Generator, lines: list[str]) -> Path:
    end = str(rng.choice(["\n", "\r\n"]))
    text = end.join(lines) + (end if rng.random() < 0.8 else "")
    encoding = str(rng.choice(ENCODINGS))
    data = text.encode(encoding)
    if encoding == "utf-16" and rng.random() < 0.5:
        data = codecs.BOM_UTF16_BE + text.encode("utf-16-be")
    path.write_bytes(data)
    return path


def _style(rng: np.random.Generator) -> tuple[str, str]:
    """Delimiter and decimal sign of a country."""
    return [(",", "."), ("\t", "."), (";", ","), ("\t", ",")][rng.integers(4)]


def _columns(rows: list[list[str]], delimiter: str, trailing: bool) -> list[str]:
    """Lines of columns of different lengths."""
    n = max(map(len, rows))
    end = delimiter if trailing else ""
    return [
        delimiter.join(column[k] if k < len(column) else "" for column in rows) + end
        for k in range(n)
    ]


def _label(name: str, rate: float, count: int, unit: str) -> str:
    text = f"Sampling frequency: {rate:.7g} Number of points: {count}"
    return f"Label: {name} {text} Unit: {unit} Domain: Time"


def emgworks(path: Path, rng: np.random.Generator) -> Made:
    rate, (sign, point) = float(rng.choice(RATES)), _style(rng)
    count = int(rng.integers(1, 5))
    volts = _signals(rng, count, rate)
    stated, offered = bool(rng.random() < 0.3), bool(rng.random() < 0.6)
    names = [f"Trigno IM sensor {k + 1}: {MUSCLES[k]} EMG {k + 1}" for k in range(count)]
    unit, factor = [("V", 1.0), ("Volts", 1.0), ("mV", 1e3), ("uV", 1e6)][rng.integers(4)]
    head, cells, columns, others, above = [], [], list[list[str]](), [], []
    time = np.arange(volts.shape[1]) / rate
    for name, values in zip(names, volts, strict=True):
        cells += ["X[s]", f"{name} [{unit}]"]
        columns += [_numbers(time, point, ".9f"), _numbers(factor * values, point)]
        above.append(_label(name, rate, time.size, unit))
    if offered:
        slow = np.arange(int(time[-1] * 148.148)) / 148.148
        for axis in "XYZ":
            name = f"Trigno IM sensor 1: Acc 1.{axis}"
            others.append(name)
            cells += ["X[s]", f"{name} [g]"]
            columns += [_numbers(slow, point, ".9f"), _numbers(rng.normal(size=slow.size), point)]
            above.append(_label(name, 148.148, slow.size, "g"))
    if stated:
        head = above
    trailing = bool(rng.random() < 0.4)
    lines = [*head, sign.join(cells) + (sign if trailing else "")]
    lines += _columns(columns, sign, trailing)
    _written(path, rng, lines)
    return Made(path, names, rate, volts, others, 1e-12, {})


def trigno_discover(path: Path, rng: np.random.Generator) -> Made:
    rate, (sign, point) = float(rng.choice(RATES)), _style(rng)
    count = int(rng.integers(1, 5))
    volts = _signals(rng, count, rate)
    pairs = bool(rng.random() < 0.4)  # two channels of one sensor share a column of times
    periods, marks, inertial = (bool(rng.random() < 0.5) for _ in range(3))
    sensors, modes, names, rates, steps = (list[str]() for _ in range(5))
    columns, labels, others = list[list[str]](), list[str](), list[str]()
    time = np.arange(volts.shape[1]) / rate

    def add(sensor: str, name: str, hertz: str, step: str, values: list[str]) -> None:
        sensors.append(sensor)
        modes.append("sensor mode: 65" if sensor else "")
        names.append(name)
        rates.append(hertz)
        steps.append(step)
        columns.append(values)

    for k, values in enumerate(volts):
        second = pairs and k % 2 == 1
        sensor = f"{MUSCLES[k - second]} sensor ({75923 + k - second})"
        channel = "EMG 2" if second else "EMG 1"
        if not second:
            add(sensor, "EMG 1 Time Series (s)", "", "", _numbers(time, point, ".9f"))
        hertz, step = (t.replace(".", point) for t in (f"{rate:.7g} Hz", f"{1 / rate:.6f} s"))
        add("", f"{channel} (mV)", hertz, step, _numbers(1e3 * values, point))
        labels.append(f"{sensor}: {channel}")
        if inertial and not pairs:
            slow = np.arange(int(time[-1] * 148.1481)) / 148.1481
            for what, unit in (("ACC X", "G"), ("GYRO Y", "deg/s")):
                add("", f"{what} Time Series (s)", "", "", _numbers(slow, point, ".9f"))
                hertz, step = (t.replace(".", point) for t in ("148.1481 Hz", "0.006750 s"))
                motion = _numbers(rng.normal(size=slow.size), point)
                add("", f"{what} ({unit})", hertz, step, motion)
                others.append(f"{sensor}: {what}")
    if marks:
        for cell in ("Type", "Name", "Label", "Time (s)"):
            add("", "" if periods else "", "", cell if periods else "", [])
    lines = [
        sign.join(["Application:", "Trigno Discover (2.1.0.7)"]),
        sign.join(["Date/Time:", "2026-02-03 10:11:12"]),
        sign.join(["Collection Length (seconds):", f"{time[-1]:.3f}".replace(".", point)]),
        *(sign.join(cells) for cells in (sensors, modes, names, rates)),
    ]
    lines += [sign.join(steps)] if periods else []
    _written(path, rng, lines + _columns(columns, sign, False))
    return Made(path, labels, rate, volts, others, 1e-12, {})


def acqknowledge(path: Path, rng: np.random.Generator) -> Made:
    interval, unit = [("1", "msec"), ("0.5", "msec"), ("500", "usec"), ("0.001", "sec")][
        rng.integers(4)
    ]
    rate = 1.0 / (float(interval) * {"usec": 1e-6, "msec": 1e-3, "sec": 1.0}[unit])
    sign, point = _style(rng)
    count = int(rng.integers(1, 4))
    volts = _signals(rng, count, rate)
    n = volts.shape[1]
    names, units, numbers = list[str](), list[str](), list[int]()
    columns, others = list[list[str]](), list[str]()
    for k, values in enumerate(volts):
        word, factor = [("mV", 1e3), ("Volts", 1.0), ("microvolts", 1e6)][rng.integers(3)]
        names.append(f"{MUSCLES[k]} EMG100C")
        units.append(word)
        numbers.append(k + 1)
        columns.append(_numbers(factor * values, point))
    for name, word, number in (("Digital input", "Volts", 28), ("ZYG integrated", "mV", 40)):
        if rng.random() < 0.5:
            names.append(name)
            units.append(word)
            numbers.append(number)
            others.append(name)
            columns.append(_numbers(np.abs(rng.normal(size=n)), point))
    clock, counts, trailing = (bool(rng.random() < 0.5) for _ in range(3))
    if clock:
        columns.insert(0, _numbers(1e3 * np.arange(n) / rate, point))
    ahead = ["milliSec"] if clock else []
    empty = [""] if clock else []
    end = sign if trailing else ""
    lines = ["recording.acq"]
    lines += ["Recording on: 2025-02-21 11:05:38.634"] if rng.random() < 0.4 else []
    lines += [f"{interval.replace('.', point)} {unit}/sample", f"{len(names)} channels"]
    for name, word in zip(names, units, strict=True):
        lines += [name, word]
    lines.append(sign.join([*ahead, *(f"CH{k}" for k in numbers)]) + end)
    if counts:
        lines.append(sign.join([*empty, *(str(n) for _ in names)]) + end)
    _written(path, rng, lines + _columns(columns, sign, trailing))
    return Made(path, names[:count], rate, volts, others, 1e-12, {})


def opensignals(path: Path, rng: np.random.Generator) -> Made:
    rate, bits = float(rng.choice([1000, 500, 2000])), int(rng.choice([10, 12, 16]))
    device, supply, gain, modulus = [
        ("biosignalsplux", 3.0, 1000.0, 65536), ("bitalino_rev", 3.3, 1009.0, 16)
    ][rng.integers(2)]  # fmt: skip
    count = int(rng.integers(1, 5))
    volts = _signals(rng, count, rate)
    counts = np.round((volts * gain / supply + 0.5) * 2**bits)
    lines_in = ["DI"] if device == "biosignalsplux" else ["I1", "I2", "O1", "O2"]
    names = [f"CH{k + 1}" for k in range(count)]
    sensors, labels, others = ["EMG"] * count, [f"{name} EMG" for name in names], list[str]()
    values = list(counts)
    if rng.random() < 0.5:
        names.append("CH9")
        sensors.append("ECG")
        others.append("CH9 ECG")
        values.append(rng.integers(0, 2**bits, volts.shape[1]).astype(float))
    n = volts.shape[1]
    number = np.arange(n) % modulus if device != "biosignalsplux" else np.arange(n)
    header = {
        "00:07:80:3B:46:61": {
            "sensor": sensors, "device name": "00:07:80:3B:46:61", "device": device,
            "column": ["nSeq", *lines_in, *names], "channels": list(range(1, len(names) + 1)),
            "label": names, "sampling rate": int(rate), "resolution": [bits] * len(names),
            "convertedValues": 0, "date": "2026-1-2", "time": "10:29:43.2",
        }
    }  # fmt: skip
    if device != "biosignalsplux":  # resolutions of all columns
        header["00:07:80:3B:46:61"]["resolution"] = [4, 1, 1, 1, 1, *[bits] * len(names)]
    head = "# OpenSignals Text File Format" + str(rng.choice(["", ". Version 1"]))
    columns = [[str(int(v)) for v in number]]
    columns += [["0"] * n for _ in lines_in]
    columns += [[str(int(v)) for v in row] for row in values]
    lines = [head, "# " + json.dumps(header), "# EndOfHeader"]
    _written(path, rng, lines + _columns(columns, "\t", True))
    return Made(path, labels, rate, volts, others, 0.51 * supply / gain / 2**bits, {})


def noraxon(path: Path, rng: np.random.Generator) -> Made:
    rate = float(rng.choice([1000.0, 1500.0, 2000.0, 4000.0]))
    count = int(rng.integers(1, 5))
    volts = _signals(rng, count, rate)
    n = volts.shape[1]
    time = np.arange(n) / rate
    kind = str(rng.choice(["mr3", "mr4 without units", "xp", "signal"]))
    names = [f"RT {MUSCLES[k].replace('(', '').replace(')', '')}" for k in range(count)]
    others = list[str]()
    if kind == "xp":
        columns = [_numbers(time, ".", ".6f"), *(_numbers(1e6 * v, ".") for v in volts)]
        lines = ["\t".join(["Time,s", *(f"{name},uV" for name in names)])]
        _written(path, rng, lines + _columns(columns, "\t", False))
        return Made(path, names, rate, volts, others, 1e-12, {})
    sign, point = _style(rng)
    if kind == "signal":
        names, volts = ["Ultium_EMG-RT_ZYG"], volts[:1]
        keys = ["type", "name", "time_units", "begin_time", "frequency", "count", "units"]
        messages = ["signal", names[0], "s", "0" + point + "0", f"{rate:g}", str(n), "uV"]
        columns = [_numbers(time, point, ".6f"), _numbers(1e6 * volts[0], point)]
        labels = ["time", "value"]
    else:
        keys = ["type", "begin_time", "frequency", "count", "created with version", "record_name"]
        messages = ["record", "0" + point + "0", f"{rate:g}", str(n), "Noraxon MR 3.18", "smile"]
        unit = " (uV)" if kind == "mr3" else ""
        labels = ["time", "Activity", "Marker", *(f"{name}{unit}" for name in names)]
        columns = [_numbers(time, point, ".6f"), ["REST", *[""] * (n - 1)], [""] * n]
        columns += [_numbers(1e6 * v, point) for v in volts]
        if kind == "mr3":
            others.append("Ultium EMG.Internal Accel 1 Ax")
            labels.append(f"{others[0]} (mG)")
            columns.append(_numbers(rng.normal(size=n), point))
    lines = [sign.join(keys), sign.join(messages), "", sign.join(labels)]
    _written(path, rng, lines + _columns(columns, sign, False))
    units = {} if kind != "mr4 without units" else {"emg": "uV"}
    return Made(path, names, rate, volts, others, 1e-12, units)


EXPORTS: dict[str, Callable[[Path, np.random.Generator], Made]] = {
    "EMGworks": emgworks,
    "Trigno Discover": trigno_discover,
    "AcqKnowledge": acqknowledge,
    "OpenSignals": opensignals,
    "Noraxon": noraxon,
}

"""MATLAB and HDF5 arrays, tables without labels and converter counts with sidecars."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from emgface.errors import ConfigurationError, DataError
from emgface.recordings.dataset import read_recording
from emgface.recordings.labels import note

CHANNELS = ["EMG 1", "EMG 2", "EMG 3"]
MARKERS = ["M1", "M2"]


def arrays() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(6)
    position = rng.uniform(-50, 50, size=(2, 3, 10))
    position[1, :, 4] = np.nan
    return {"emg": rng.normal(size=(40, 3)), "position": position, "t": np.arange(40.0) / 2}


def save_v5(path: Path) -> None:
    given = arrays()
    content = {
        "rec": {"emg": given["emg"], "t": given["t"][:, None]},
        "names": np.array(CHANNELS, dtype=object),
        "position": given["position"],
    }
    scipy.io.savemat(path, content, do_compression=True)


def save_v73(path: Path) -> None:
    """Write as MATLAB does: a user block, dims reversed, texts as references to characters."""
    given = arrays()
    with h5py.File(path, "w", userblock_size=512) as opened:
        opened["rec/emg"] = given["emg"].T
        opened["rec/t"] = given["t"][None, :]
        opened["position"] = given["position"].T
        references = []
        for i, name in enumerate(CHANNELS):
            stored = opened.create_dataset(
                f"#refs#/{i}", data=np.array([[ord(c)] for c in name], "u2")
            )
            references.append(stored.ref)
        opened.create_dataset("names", data=np.array(references, dtype=h5py.ref_dtype)[None, :])
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


SAVED = [pytest.param(save_v5, id="v5"), pytest.param(save_v73, id="v7.3")]


def sidecar(folder: Path, emg: str, position: str = "") -> Path:
    path = folder / "trial.toml"
    path.write_text(
        f'schema = "recording"\n[emg]\n{emg}\n' + (position and f"[position]\n{position}\n")
    )
    return path


EMG = 'file = "a.mat"\nvariable = "rec.emg"\ncolumns_variable = "names"\nunit = "mV"'
POSITION = (
    'file = "a.mat"\nvariable = "position"\ndims = ["marker", "axis", "time"]\nrate = 100\n'
    'columns = ["M1", "M2"]\nunit = "mm"'
)


@pytest.mark.parametrize("save", SAVED)
def test_arrays_of_matlab_are_read(tmp_path: Path, save: Callable[[Path], None]) -> None:
    save(tmp_path / "a.mat")
    timed = f'{EMG}\ntime = "rec.t"\ntime_unit = "ms"'
    trial = read_recording(sidecar(tmp_path, timed, POSITION))
    given = arrays()
    assert list(trial["channel"].values) == CHANNELS
    assert list(trial["marker"].values) == MARKERS
    np.testing.assert_array_equal(trial["emg"], given["emg"].T / 1e3)
    np.testing.assert_array_equal(trial["position"], given["position"] / 1e3)
    np.testing.assert_array_equal(trial["time_emg"], given["t"] / 1e3)
    assert note(trial, "original_units") == {"emg": "mV", "position": "mm"}


@pytest.mark.parametrize("save", SAVED)
@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("rec.emg", "rec.egm", "no variable 'egm' .did you mean 'emg'"),
        ("rec.emg", "recording", "no variable 'recording'"),
        ('"rec.emg"', '"names"', "expected real numbers"),
        (
            'columns_variable = "names"',
            'columns = ["a", "b"]',
            "columns for 2 labels; expected one",
        ),
        (
            'columns_variable = "names"',
            'dims = ["channel", "time"]',
            "40 samples|3 instants|3 samp",
        ),
        ('"rec.emg"', '"position"', "shape .2, 3, 10.; expected dims time, channel"),
        ('columns_variable = "names"', 'columns_variable = "rec.emg"', "contains no text|labels"),
    ],
)
def test_a_sidecar_that_does_not_match_is_refused(
    tmp_path: Path, save: Callable[[Path], None], old: str, new: str, text: str
) -> None:
    save(tmp_path / "a.mat")
    timed = f'{EMG}\ntime = "rec.t"'
    assert old in timed
    with pytest.raises(DataError, match=text):
        read_recording(sidecar(tmp_path, timed.replace(old, new)))


@pytest.mark.parametrize("save", SAVED)
def test_truncated_files_are_refused(tmp_path: Path, save: Callable[[Path], None]) -> None:
    save(tmp_path / "a.mat")
    whole = (tmp_path / "a.mat").read_bytes()
    path = sidecar(tmp_path, f'{EMG}\ntime = "rec.t"')
    for part in (0.0, 0.02, 0.2, 0.5, 0.8):
        (tmp_path / "a.mat").write_bytes(whole[: int(len(whole) * part)])
        with pytest.raises(DataError, match="a.mat (cannot be read|has [0-9]+ bytes)"):
            read_recording(path)


def test_arrays_and_tables_are_distinguished(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="a.mat requires variable"):
        read_recording(sidecar(tmp_path, 'file = "a.mat"\nrate = 5\nunit = "V"'))
    with pytest.raises(
        ConfigurationError, match="a.csv contains no variables; expected one of .mat"
    ):
        read_recording(sidecar(tmp_path, 'file = "a.csv"\nvariable = "x"\nrate = 5\nunit = "V"'))
    with pytest.raises(ConfigurationError, match="dims are time and channel, or time, marker"):
        bad = 'file = "a.mat"\nvariable = "x"\ndims = ["time"]\nrate = 5\nunit = "V"'
        read_recording(sidecar(tmp_path, bad))


def test_a_file_without_its_required_sidecar_is_refused(tmp_path: Path) -> None:
    save_v5(tmp_path / "a.mat")
    with pytest.raises(DataError, match="a.mat does not specify its contents.*write one inst"):
        read_recording(tmp_path / "a.mat")
    (tmp_path / "a.toml").write_text('schema = "recording"')
    with pytest.raises(DataError, match="specify a.toml, which is in the same folder"):
        read_recording(tmp_path / "a.mat")


def test_counts_become_volts(tmp_path: Path) -> None:
    counts = np.array([[0], [2048], [4095]], dtype=np.uint16)
    with h5py.File(tmp_path / "a.h5", "w") as opened:
        opened["device/raw/channel_1"] = counts
    line = 'file = "a.h5"\nvariable = "device/raw/channel_1"\nrate = 1000\nunit = "V"\n'
    trial = read_recording(sidecar(tmp_path, line + "zero = 2048\nstep = 7.32421875e-07"))
    expected = (counts[:, 0] / 4096 - 0.5) * 3.0 / 1000
    np.testing.assert_allclose(trial["emg"].values[0], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("scale_factor", 1e-3, "scale_factor = 0.001, by which its numbers are to be converted"),
        ("add_offset", 2.0, "add_offset = 2"),
        ("conversion", [1.0, 0.5], "conversion = "),
        ("offset", np.float32(1.0), "offset = 1"),
        ("units", "uV", "is in uV by its attribute units, and in mV by the sidecar"),
        ("unit", b"microvolts", "is in uV by its attribute unit,"),
    ],
)
def test_attributes_that_convert_the_numbers_are_not_passed_over(tmp_path, key, value, text):
    """Other programs apply them; neutral ones and units of no known quantity are no contradiction."""
    with h5py.File(tmp_path / "a.h5", "w") as opened:
        opened["emg"] = np.linspace(0.0, 1.0, 40).reshape(20, 2)
        for name, neutral in (("scale_factor", 1.0), ("add_offset", 0), ("units", "a.u.")):
            opened["emg"].attrs[name] = neutral
    line = (
        'file = "a.h5"\nvariable = "emg"\nrate = 1000\nunit = "mV"\ncolumns = ["ZYG_L", "ZYG_R"]\n'
    )
    path = sidecar(tmp_path, line)
    assert float(read_recording(path)["emg"].max()) == 1e-3
    with h5py.File(tmp_path / "a.h5", "a") as opened:
        opened["emg"].attrs[key] = value
    with pytest.raises(DataError, match=text):
        read_recording(path)
    converted = read_recording(sidecar(tmp_path, line + "step = 0.5"))
    assert float(converted["emg"].max()) == 0.5e-3


def test_flags_are_not_signals(tmp_path):
    """Logical arrays of MATLAB, which scipy returns as integers, before and from version 7.3."""
    line = (
        'file = "a.mat"\nvariable = "emg"\nrate = 1000\nunit = "mV"\ncolumns = ["ZYG_L", "ZYG_R"]\n'
    )
    flags = np.arange(40).reshape(20, 2) % 3 == 0
    scipy.io.savemat(tmp_path / "a.mat", {"emg": flags})
    path = sidecar(tmp_path, line)
    with pytest.raises(DataError, match="contains bool .* expected real numbers"):
        read_recording(path)
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as opened:
        opened["emg"] = flags.T.astype(np.uint8)
        opened["emg"].attrs["MATLAB_class"] = np.bytes_("logical")
    content = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + content[512:])
    with pytest.raises(DataError, match="contains bool .* expected real numbers"):
        read_recording(path)


def test_a_table_without_labels_and_with_text(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("made today\n1.5\t2\tgo\t\n2.5\t3\tstop\t\n")
    head = 'file = "a.txt"\ndelimiter = "\\t"\nskip_rows = 1\nrate = 100\nunit = "mV"\n'
    named = head + 'columns = ["zyg", "skin", "mark"]\n'
    trial = read_recording(sidecar(tmp_path, named + '[emg.channels]\nzyg = "ZYG_L"'))
    np.testing.assert_array_equal(trial["emg"], [[1.5e-3, 2.5e-3]])
    assert note(trial, "dropped") == {
        "mark": "not in the mapping; contains text", "skin": "not in the mapping",
    }  # fmt: skip
    with pytest.raises(DataError, match="column 'mark' contains 'go'; expected a number"):
        read_recording(sidecar(tmp_path, named))
    with pytest.raises(DataError, match="a.txt has 3 columns, and trial.toml lists 1"):
        read_recording(sidecar(tmp_path, head + 'columns = ["zyg"]'))


REAL = {
    "biosignalsnotebooks/emg_bursts.h5": (
        'variable = "00:07:80:3B:46:61/raw/channel_3"\nrate = 1000\nunit = "V"\n'
        "zero = 32768\nstep = 4.57763671875e-08",
        (1, 28519),
    ),
    "biosignalsnotebooks/emg_fatigue.h5": (
        'variable = "00:07:80:4C:01:B1/raw/channel_2"\nrate = 1000\nunit = "V"\n'
        "zero = 2048\nstep = 7.32421875e-07",
        (1, 126900),
    ),
    "oxazepam-facial-emg/24_FMOV_preprocessed.txt": (
        'delimiter = "\\t"\nrate = 100\nunit = "mV"\n'
        'columns = ["scr", "zyg", "corr", "zyg_rect", "corr_rect", "angry", "happy", "neutral"]\n'
        '[emg.channels]\nzyg = "ZYG_L"\ncorr = "COR_L"',
        (2, 38980),
    ),
    "subvocal-facial-emg/P001_A_Nao.csv.gz": (
        'rate = 250\nunit = "uV"\n[emg.channels]\n'
        + "\n".join(f'Channel_{i} = "face {i}"' for i in range(1, 6)),
        (5, 25067),
    ),
}


@pytest.mark.parametrize("name", REAL)
def test_real_files_are_read_by_a_sidecar(shared: Path, tmp_path: Path, name: str) -> None:
    source = shared / "recordings" / name
    if not source.is_file():
        pytest.skip(f"{name} is not there")
    line, shape = REAL[name]
    described = sidecar(tmp_path, f'file = "{source.name}"\n{line}')
    trial = read_recording(described, folder=source.parent)
    assert trial["emg"].shape == shape


def test_a_real_trajectory_is_read_by_a_sidecar(shared: Path, tmp_path: Path) -> None:
    source = shared / "recordings" / "artisynth-jaw" / "jawPosition.txt"
    if not source.is_file():
        pytest.skip("the trajectory is not there")
    (tmp_path / "jaw.toml").write_text(
        f'schema = "recording"\n[position]\nfile = "{source.name}"\ndelimiter = " "\n'
        'skip_rows = 2\ncolumns = ["t", "jaw_x", "jaw_y", "jaw_z"]\ntime = "t"\nunit = "mm"\n'
    )
    trial = read_recording(tmp_path / "jaw.toml", folder=source.parent)
    assert trial["position"].shape == (1, 3, 1017)
    span = np.ptp(trial["position"].values[0], axis=1) * 1e3
    np.testing.assert_allclose(span, [3.16, 1.47, 2.53], atol=0.005)  # as stated with the file

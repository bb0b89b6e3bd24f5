"""Recording browser: bins, filter of a part, marks of the user, and the mapping of them."""

import base64
import json
import warnings
import zlib

import numpy as np
import pytest
import xarray as xr
from scipy.signal import welch
from typer.testing import CliRunner

import emgface as ef
from emgface.cli import app
from emgface.errors import ConfigurationError, SchemaError
from emgface.muscles import CHANNELS
from emgface.recordings.dataset import read_recording
from emgface.recordings.findings import findings_in
from emgface.recordings.labels import read_label_map
from emgface.schema.netcdf import write_netcdf
from emgface.signals.filters import bandpass
from emgface.signals.parameters import FilterParameters
from emgface.view.pyramid import BUDGET, GAP, bins_of, coarse_enough
from emgface.view.recording import RecordingPage, findings_shown, recording_page
from emgface.view.server import LocalServer
from tests.browser import needs_browser, until
from tests.data.made_recordings import emg, noise


@pytest.fixture(scope="module")
def recording():
    """Fourteen channels of 8 s, 2048 Hz, with markers of 100 Hz."""
    rng = np.random.default_rng(5)
    time = np.arange(800) / 100.0
    markers = ["nasion", "corner_left", "corner_right"]
    position = 0.01 * rng.normal(size=(3, 3, 1)) + 1e-3 * np.sin(time + np.arange(3)[:, None, None])
    signals = emg(noise())
    return xr.Dataset(
        {
            "emg": signals,
            "position": (("marker", "axis", "time_marker"), position, {"units": "m"}),
        },
        {
            "marker": markers,
            "axis": ["x", "y", "z"],
            "time_marker": ("time_marker", time, {"units": "s"}),
        },
        {"origin": "simulated", "instruction": "A"},
    )  # fmt: skip


@pytest.fixture
def stored(recording, tmp_path):
    return write_netcdf(recording, tmp_path / "trial.nc", "recording")


def test_bins_contain_the_extremes_and_the_gaps():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(3, 1001))
    values[1, 100:200] = np.nan
    bins = bins_of(values, 10)
    assert bins.low.shape == (3, 101)
    for k in range(3):
        for b in range(101):
            part = values[k, 10 * b : 10 * (b + 1)]
            if not np.isfinite(part).any():
                assert bins.low[k, b] == bins.high[k, b] == GAP
                continue
            assert abs(bins.low[k, b] * bins.scale[k] - np.nanmin(part)) <= bins.scale[k]
            assert abs(bins.high[k, b] * bins.scale[k] - np.nanmax(part)) <= bins.scale[k]
    np.testing.assert_allclose(32767 * bins.scale, np.nanmax(np.abs(values), axis=1))
    assert (bins_of(np.full((1, 5), np.nan), 2).low == GAP).all()
    assert not bins_of(np.zeros((1, 5)), 2).low.any()


@pytest.mark.parametrize(("rows", "samples"), [(1, 10), (14, 4096), (64, 7_200_000), (256, 10**9)])
def test_pages_stay_within_their_size(rows, samples):
    size = coarse_enough(rows, samples)
    assert rows * -(-samples // size) * (2 if size == 1 else 4) <= BUDGET + 4 * rows


def test_a_part_is_filtered_as_the_whole(recording):
    """The page shows what the signal chain uses: difference below 1e-3 of the largest value."""
    page = RecordingPage(recording, "trial")
    page.html(served=True)
    whole = bandpass(recording["emg"], FilterParameters()).values
    answer = page.span({"start": "6000", "stop": "8000", "columns": "4000", "filtered": "1"})
    count, size = np.frombuffer(answer.body[:8], "<i4")
    values = np.frombuffer(answer.body[8:], "<i2").reshape(2, 14, count)
    assert (count, size) == (2000, 1)
    np.testing.assert_array_equal(values[0], values[1])
    shown = values[0] * page._scales[True][:, None]
    assert np.abs(shown - whole[:, 6000:8000]).max() < 1e-3 * np.abs(whole).max()


@pytest.mark.parametrize(
    "query",
    [
        {},
        {"start": "0", "stop": "10"},
        {"start": "-1", "stop": "10", "columns": "5"},
        {"start": "10", "stop": "10", "columns": "5"},
        {"start": "0", "stop": "999999999", "columns": "5"},
        {"start": "0", "stop": "10", "columns": "100000"},
        {"start": "nan", "stop": "10", "columns": "5"},
    ],
)
def test_impossible_parts_are_refused(recording, query):
    assert RecordingPage(recording, "trial").span(query).status == 400


def test_names_with_markup_and_signals_without_numbers_are_shown(recording):
    changed = recording.assign_coords(channel=["</script><b>", *recording["channel"].values[1:]])
    changed["emg"] = changed["emg"].copy()
    changed["emg"][1] = np.nan
    changed["emg"][2] = 0.0
    html = recording_page(changed)
    assert "</script><b>" not in html and "\\u003c/script" in html
    assert len(html) < 4_000_000


def test_unusable_parts_of_a_mapping(stored):
    mapping = {
        "unusable": {
            "channels": ["ZYG_L"],
            "markers": ["nasion"],
            "spans": [
                {"start": 2.0, "stop": 2.5, "channels": ["MEN_R"]},
                {"start": 7.0, "stop": 7.1},
            ],
        }
    }
    opened = read_recording(stored, mapping=mapping)
    assert "ZYG_L" not in opened["channel"].values and opened.sizes["channel"] == 13
    assert np.isnan(opened["position"].sel(marker="nasion")).all()
    t = opened["time_emg"]
    gone = np.isnan(opened["emg"].sel(channel="MEN_R"))
    expected = ((t >= 2.0) & (t <= 2.5)) | ((t >= 7.0) & (t <= 7.1))
    np.testing.assert_array_equal(gone, expected)
    np.testing.assert_array_equal(
        np.isnan(opened["emg"].sel(channel="OOS_L")), (t >= 7.0) & (t <= 7.1)
    )
    codes = {(f.code, f.kind, f.name) for f in findings_in(opened)}
    assert {
        ("bad", "channel", "ZYG_L"),
        ("bad", "marker", "nasion"),
        ("bad_interval", "channel", "MEN_R"),
        ("bad_interval", "channel", ""),
        ("bad_frames", "marker", ""),
    } <= codes
    named = read_recording(
        stored, mapping={**mapping, "channels": {"ZYG_L": "ZYG_R", "MEN_R": "MEN_L"}}
    )
    assert list(named["channel"].values) == ["MEN_L"]
    assert np.isnan(named["emg"]).sum() == expected.sum()


@pytest.mark.parametrize(
    ("unusable", "expected"),
    [
        ({"channels": ["ZYG"]}, "The file has no channel 'ZYG'"),
        ({"markers": ["nose"]}, "The file has no marker 'nose'"),
        ({"spans": [{"start": 1.0, "stop": 2.0, "channels": ["none"]}]}, "no channel 'none'"),
        ({"spans": [{"start": 2.0, "stop": 1.0}]}, "from 2 to 1 s contains no sample"),
        ({"spans": [{"start": 100.0, "stop": 101.0}]}, "contains no sample"),
        ({"spans": [{"start": float("nan"), "stop": 1.0}]}, "should be a finite number"),
        ({"spans": [{"stop": 1.0}]}, "start"),
    ],
)
def test_unusable_parts_that_the_file_lacks_are_refused(stored, unusable, expected):
    with pytest.raises((SchemaError, ConfigurationError), match=expected):
        read_recording(stored, mapping={"unusable": unusable})


def test_a_recording_without_a_usable_channel_has_no_emg(stored):
    opened = read_recording(stored, mapping={"unusable": {"channels": list(CHANNELS)}})
    assert "emg" not in opened and "position" in opened


@needs_browser
def test_marks_of_the_page_reach_every_command(stored, recording, browser, tmp_path):
    """A channel is marked in the browser, the mapping saved; `activate` and a study use it."""
    target = tmp_path / "mapping.toml"
    unusable = {
        "markers": ["corner_left"],
        "spans": [{"start": 0.0, "stop": 0.1, "markers": ["corner_right"]}],
    }
    kept = {
        "volunteer": "V7",
        "instructions": {"smile": "B"},
        "marks": {"noise": {"meaning": "bad", "seconds": 0.5, "by": 'A "S"'}},
    }
    given = read_label_map({**kept, "unusable": unusable})
    data = read_recording(stored, mapping=given)
    page = RecordingPage(data, "trial", findings_shown(data), target, given)
    server = LocalServer(
        page.html(served=True), get={"span": page.span}, post={"mapping": page.save}
    )
    server.start()
    try:
        browser.get_log("browser")
        browser.get(server.url)
        stage = "document.getElementById('traces').dataset"
        until(browser, f"return {stage}.ready === 'yes'")
        keys = browser.find_element("id", "traces")
        down, right = "\ue015", "\ue014"
        keys.send_keys(down, down)
        until(browser, f"return {stage}.chosen === 'RIS_L'")
        keys.send_keys("b")
        browser.execute_script(
            "const n = document.getElementById('name'); document.getElementById('traces').focus();"
        )
        keys.send_keys(down, "+", "+", right)
        until(browser, f"return {stage}.chosen === 'ZYG_L' && Number({stage}.from) > 0.1")
        start, stop = (float(browser.execute_script(f"return {stage}.{k}")) for k in ("from", "to"))
        until(browser, f"return Number({stage}.detail || 0) > 0 || true")
        browser.execute_script("document.getElementById('span-one').click()")
        browser.execute_script("document.getElementById('span-all').click()")
        browser.execute_script("document.getElementById('undo').click()")
        for control in ("whole", "in", "out", "back", "forth", "higher", "lower", "same", "filtered",
                        "hide", "show-all", "up", "down", "play", "play", "name-markers"):  # fmt: skip
            browser.execute_script(f"document.getElementById('{control}').click()")
        browser.execute_script(
            "const f = document.getElementById('find'); f.value = 'MEN';"
            "f.dispatchEvent(new Event('input'))"
        )
        until(browser, "return document.getElementById('state').textContent.includes('2 of 14')")
        until(browser, f"return {stage}.chosen === 'MEN_L'")
        browser.execute_script(
            "const n = document.getElementById('name'); n.value = 'MEN_L';"
            "n.dispatchEvent(new Event('change'))"
        )
        browser.execute_script("document.getElementById('save').click()")
        until(browser, f"return {stage}.saved === 'mapping.toml'")
        assert not [e for e in browser.get_log("browser") if e["level"] == "SEVERE"
                    and "favicon" not in e["message"]]  # fmt: skip
    finally:
        server.stop()
    written = read_label_map(target)
    assert written.volunteer == "V7" and written.unusable.channels == ["RIS_L"]
    assert written.model_dump(include=set(kept)) == given.model_dump(include=set(kept))
    known, one = written.unusable.spans
    assert (written.unusable.markers, known) == (["corner_left"], given.unusable.spans[0])
    assert one.channels == ["ZYG_L"] and one.start == pytest.approx(start, abs=1e-5)
    assert one.stop == pytest.approx(stop, abs=1e-5)
    given = ["activate", str(stored), "--mapping", str(target), "--strategy", "act_all"]
    result = CliRunner().invoke(app, [*given, "--out", str(tmp_path / "a.nc")])
    # A gap of a used channel is an error that names the channel.
    assert result.exit_code and "ZYG_L" in f"{result.output} {result.exception}", result.output
    text = target.read_text()
    target.write_text(text[: text.index("[[unusable.spans]]")])  # without the span it is used
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        used = ef.activate(stored, mapping=target, strategy="act_all", missing_side="mirror")
        whole = ef.activate(stored, strategy="act_all")
    # The risorius of the left has no channel of its own any more: it is mirrored from the right.
    left, right = (used["activation"].sel(muscle=f"RIS_{side}").values for side in "LR")
    np.testing.assert_array_equal(left, right)
    assert np.abs(whole["activation"].sel(muscle="RIS_L").values - left).max() > 0.01


PIXELS = """
const c = document.getElementById("traces");
const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
let sum = 0; const words = new Uint32Array(d.buffer);
for (let i = 0; i < words.length; i++) sum = (Math.imul(sum, 31) + words[i]) | 0;
return [sum, new Set(words).size, Number(c.dataset.columns), c.width];
"""


@needs_browser
def test_a_scrolled_view_equals_one_that_is_drawn_anew(recording, browser, tmp_path):
    """Every pixel, after steps to both sides, at several scales; only new columns are drawn."""
    path = tmp_path / "page.html"
    path.write_text(recording_page(recording), encoding="utf-8")
    browser.get(path.as_uri())
    stage = "document.getElementById('traces').dataset"
    until(browser, f"return {stage}.ready === 'yes'")

    def press(key):
        before = browser.execute_script(f"return {stage}.frames")
        browser.execute_script(
            "document.getElementById('traces').dispatchEvent("
            "new KeyboardEvent('keydown', {key: arguments[0]}))",
            key,
        )
        until(browser, f"return {stage}.frames !== '{before}'")

    seen = set()
    for zooms in (2, 6, 9):  # the last shows single samples
        for _ in range(zooms):
            press("+")
        for key in ("ArrowRight",) * 5 + ("ArrowLeft",) * 3:
            press(key)
            columns, width = browser.execute_script(PIXELS)[2:]
            assert 0 < columns < 0.2 * width
        scrolled, colours, *_ = browser.execute_script(PIXELS)
        assert colours > 3
        for _ in range(2):  # another scale of rows and back: all columns are drawn
            before = browser.execute_script(f"return {stage}.frames")
            browser.execute_script("document.getElementById('same').click()")
            until(browser, f"return {stage}.frames !== '{before}'")
        anew, _, columns, width = browser.execute_script(PIXELS)
        assert columns > 0.8 * width and anew == scrolled
        seen.add(anew)
    assert len(seen) == 3


def test_a_saved_mapping_is_checked(recording, tmp_path):
    page = RecordingPage(recording, "trial", mapping=tmp_path / "m.toml")
    for body in (b"a = [", b"[unusabel]\n", b"\xff", b"[unusable]\nchannels = 3\n"):
        assert "why" in json.loads(page.save(body).body) and not (tmp_path / "m.toml").exists()
    good = b'[unusable]\nchannels = ["ZYG_L"]\n'
    assert json.loads(page.save(good).body) == {"wrote": "m.toml"}
    assert (tmp_path / "m.toml").read_bytes() == good


def test_spectra_of_the_page_are_in_tenths_of_a_decibel(recording):
    spectra = RecordingPage(recording, "trial")._spectra()
    stored = zlib.decompress(base64.b64decode(spectra["decibel"]))
    drawn = np.frombuffer(stored, "<i2").reshape(-1, spectra["count"])
    size = 2 * (spectra["count"] - 1)
    power = welch(recording["emg"].values, 2.0 * spectra["largest"], nperseg=size)[1]
    np.testing.assert_allclose(drawn, 100.0 * np.log10(power), atol=0.51)

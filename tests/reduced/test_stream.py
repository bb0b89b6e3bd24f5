"""Streams of the Lab Streaming Layer: samples, units, losses, and messages."""

import os
import threading
import time

import numpy as np
import pytest

from emgface.errors import ConfigurationError, SignalError
from emgface.reduced.stream import Streamed

RATE, STEP = 1000.0, 0.01


@pytest.fixture(scope="module")
def lsl(tmp_path_factory):
    """Streams that are only visible on this computer."""
    settings = tmp_path_factory.mktemp("lsl") / "lsl_api.cfg"
    settings.write_text("[multicast]\nResolveScope = machine\n[log]\nlevel = -3\n")
    os.environ.setdefault("LSLAPICFG", str(settings))
    return pytest.importorskip("pylsl")


def outlet(lsl, name, labels, unit="microvolts", rate=RATE):
    info = lsl.StreamInfo(name, "EMG", len(labels), rate, "double64", name)
    channels = info.desc().append_child("channels")
    for label in labels:
        channel = channels.append_child("channel")
        channel.append_child_value("label", label)
        channel.append_child_value("unit", unit)
    return lsl.StreamOutlet(info)


def sent(lsl, out, count, skipped=(0, 0)):
    """Send numbered samples at their times, without those of a range of numbers."""
    start = lsl.local_clock()

    def send():
        for k in range(0, count, 5):
            due = start + (k + 5) / RATE
            time.sleep(max(due - lsl.local_clock(), 0.0))
            for j in range(k, k + 5):
                if not skipped[0] <= j < skipped[1]:
                    out.push_sample([1.0 * j, -1.0, 2.0 * j], start + (j + 1) / RATE)

    thread = threading.Thread(target=send)
    thread.start()
    return thread


def test_frames_contain_all_samples_in_volts_of_the_known_channels(lsl):
    """The order of the channels is that of the stream; a trigger is left out."""
    out = outlet(lsl, "numbered", ["ZYG_L", "trigger", "DAO_R"])
    source = Streamed("numbered", STEP)
    assert source.channels == ("ZYG_L", "DAO_R") and source.rate == RATE
    source.start()
    thread = sent(lsl, out, 200, skipped=(60, 100))
    blocks, losses = [], []
    for k in range(12):
        samples, arrived, lost = source.frame(k)
        assert 0.0 <= source.now() - arrived < 1.0
        blocks.append(samples)
        losses.append(lost)
    thread.join()
    values = np.concatenate(blocks, axis=1)
    kept = np.r_[0:60, 100:160]
    np.testing.assert_allclose(values[0], 1e-6 * kept, rtol=1e-12)
    np.testing.assert_allclose(values[1], 2e-6 * kept, rtol=1e-12)
    assert losses == [0] * 6 + [40] + [0] * 5


def test_a_stream_that_ends_is_an_error(lsl):
    out = outlet(lsl, "short", ["ZYG_L", "MEN_L", "DAO_R"])
    source = Streamed("short", STEP)
    source.start()
    sent(lsl, out, 25).join()
    source.frame(0)
    source.frame(1)
    with pytest.raises(SignalError, match="'short' has sent no samples for 1 s, expected 1000"):
        source.frame(2)


def test_streams_that_cannot_be_used_are_refused(lsl, monkeypatch):
    kept = [outlet(lsl, "other", ["Fz", "Cz"]), outlet(lsl, "plain", ["ZYG_L"], unit="steps")]
    with pytest.raises(SignalError, match="'other' has the channels Fz, Cz, expected some of"):
        Streamed("other", STEP)
    with pytest.raises(
        SignalError, match="channel ZYG_L has the unit 'steps', expected V, mV or uV"
    ):
        Streamed("plain", STEP)
    kept.append(outlet(lsl, "events", ["ZYG_L"], rate=0.0))
    with pytest.raises(SignalError, match="'events' has no sampling rate"):
        Streamed("events", STEP)
    monkeypatch.setattr("emgface.reduced.stream.STREAM_TIMEOUT", 0.2)
    with pytest.raises(SignalError, match="no stream 'absent' was found within 0.2 s"):
        Streamed("absent", STEP)


def test_a_stream_requires_pylsl(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pylsl", None)
    with pytest.raises(ConfigurationError, match=r"requires the package pylsl.*emgface\[stream\]"):
        Streamed("any", STEP)

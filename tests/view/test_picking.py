"""Picking: nodes that are clicked return themselves, and their lines are accepted by the commands."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from emgface.cli import app
from emgface.face.file import load_face, save_face
from emgface.fit.readers.landmarks import read_landmarks
from emgface.muscles import CHANNELS
from emgface.pictures.body import skin_of
from emgface.pictures.page import face_page
from emgface.pictures.picking import LIPS, pick_data
from emgface.pictures.render import VIEWS
from emgface.recordings.labels import read_label_map
from emgface.treatment.outline import outline_of
from emgface.treatment.plan import read_plan
from tests.browser import needs_browser, until

MARKUP = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def page(coarse, browser, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "face.html"
    path.write_text(face_page(coarse), encoding="utf-8")
    browser.get(path.as_uri())
    until(browser, "return document.getElementById('stage').dataset.picks === 'yes'")
    until(browser, "return document.getElementById('stage').dataset.ready === 'yes'")
    return browser


def axes(yaw, pitch):
    a, b = np.radians([yaw, pitch])
    ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
    return np.array([[-ca, sa, 0.0], [-sa * sb, -ca * sb, cb], [sa * cb, ca * cb, sb]])


def projected(points, name, width, height):
    """Position of points (n, 3) [mm] on a stage, and their depth, by the camera of the pictures."""
    half = 0.0
    for view in VIEWS.values():
        right, up, _ = np.ptp(points @ axes(*view).T, axis=0)
        half = max(half, 0.53 * up, 0.53 * right * height / width)
    seen = points @ axes(*VIEWS[name]).T
    seen = (seen - (seen.max(axis=0) + seen.min(axis=0)) / 2) * (height / 2 / half)
    return width / 2 + seen[:, 0], height / 2 - seen[:, 1], seen[:, 2] * 2 * half / height


@needs_browser
def test_nodes_that_are_clicked_return_themselves(coarse, page):
    skin = skin_of(coarse)
    tried = [clicked_in(coarse, skin, page, name) for name in ("front", "oblique", "left")]
    assert sum(tried) >= 100


def clicked_in(coarse, skin, page, name):
    """Number of nodes that were clicked in a view, all of which returned themselves."""
    points = 1e3 * coarse["position"].values[skin.node]
    page.execute_script(f"document.querySelector('[data-view={name}]').click()")
    size = page.execute_script(
        "const c = document.getElementById('stage'); return [c.clientWidth, c.clientHeight]"
    )
    u, v, depth = projected(points, name, *size)
    apart = np.hypot(u - u[:, None], v - v[:, None])
    # Nodes that none covers on the screen, and that no other is at the same place as.
    clear = [i for i in range(len(u)) if not ((apart[i] < 20) & (depth > depth[i] + 3)).any()
             and np.sort(apart[i])[1] > 2.0]  # fmt: skip
    chosen = np.random.default_rng(0).choice(clear, min(100, len(clear)), replace=False).astype(int)
    script = (
        "const [all] = arguments, c = document.getElementById('stage'), found = [];"
        "c.setPointerCapture = () => {};"
        "for (const [x, y] of all) { const b = c.getBoundingClientRect();"
        " for (const name of ['pointerdown', 'pointerup']) c.dispatchEvent(new PointerEvent(name,"
        "  {pointerId: 1, clientX: b.left + x, clientY: b.top + y}));"
        " found.push(Number(c.dataset.picked)); } return found"
    )
    value = page.execute_script(script, [[float(u[i]), float(v[i])] for i in chosen])
    np.testing.assert_array_equal(value, skin.node[chosen])
    return len(chosen)


def picked(page, kind, places):
    """Text of the page after some nodes (node, name) were entered by the keyboard's way."""
    for node, name in places:
        page.execute_script(
            "const [kind, node, name] = arguments, $ = (id) => document.getElementById(id);"
            "$('pick-kind').value = kind; $('pick-name').value = name; $('pick-node').value = node;"
            "$('pick-add').click()", kind, int(node), name,
        )  # fmt: skip
    return page.execute_script("return document.getElementById('pick-text').value")


@needs_browser
def test_landmarks_are_read_by_fit(coarse, page, tmp_path):
    nodes = coarse["marker_node"].values
    names = [str(m) for m in coarse["marker"].values]
    text = picked(page, "landmark", zip(nodes, names, strict=True))
    path, person = tmp_path / "on_face.csv", tmp_path / "person.csv"
    path.write_text(text, encoding="utf-8")
    landmarks = read_landmarks(path)
    assert list(landmarks.names) == names
    np.testing.assert_allclose(landmarks.position, coarse["position"].values[nodes], atol=1e-7)
    rows = [
        f"{n},{1.03 * x},{1.03 * y},{1.03 * z}"
        for n, (x, y, z) in zip(names, 1e3 * landmarks.position, strict=True)
    ]
    person.write_text("\n".join(["name,x_mm,y_mm,z_mm", *rows]))
    save_face(coarse, tmp_path / "face.nc")
    given = [
        "fit",
        "--landmarks",
        str(person),
        "--on-face",
        str(path),
        "--face",
        str(tmp_path / "face.nc"),
        "--simulated",
    ]
    result = CliRunner().invoke(app, [*given, "--out", str(tmp_path / "fitted.nc")])
    assert result.exit_code == 0, result.output
    fitted = load_face(tmp_path / "fitted.nc")["position"].values[nodes]
    size = np.ptp(landmarks.position[:, 0])
    assert np.ptp(fitted[:, 0]) == pytest.approx(1.03 * size, rel=0.01)


@needs_browser
def test_electrodes_are_lines_of_a_mapping(coarse, page, tmp_path):
    table = pick_data(coarse, skin_of(coarse))
    known = [(n, c) for n, c in zip(table["node"], table["channel"], strict=True) if c]
    first = {c: n for n, c in reversed(known)}
    assert set(first) <= set(CHANNELS) and len(first) >= 10
    (one, other), label = list(first)[:2], 'EMG "7"'
    text = picked(page, "electrode", [(first[one], "EMG 1"), (first[other], label)])
    path = tmp_path / "mapping.toml"
    path.write_text(text, encoding="utf-8")
    assert read_label_map(path).channels == {"EMG 1": one, label: other}
    text = picked(page, "electrode", [(first[other], MARKUP)])
    path.write_text(text, encoding="utf-8")
    assert read_label_map(path).channels[MARKUP] == other
    shown = page.execute_script("return document.getElementById('pick').querySelector('img')")
    assert shown is None


@needs_browser
def test_wedges_and_muscles_are_steps_of_a_plan(coarse, page, tmp_path):
    table = pick_data(coarse, skin_of(coarse))
    at = {
        lip: min((abs(p - 0.5), n, p) for n, own, p in
                 zip(table["node"], table["lip"], table["place"], strict=True) if own == lip)
        for lip in LIPS
    }  # fmt: skip
    for lip, (_, node, place) in at.items():
        page.execute_script("document.getElementById('pick-undo').click()")
        path = tmp_path / f"{lip}.toml"
        path.write_text(picked(page, "wedge", [(node, "")]), encoding="utf-8")
        step = read_plan(path).step[-1]
        assert (step.kind, step.lip, step.place) == ("wedge", lip, place)
        chart = outline_of(coarse, step).chart
        away = np.linalg.norm(chart.origin - coarse["position"].values[node])
        assert away < 0.015  # at the margin next to the node
    muscle, node = next((m, n) for m, n in zip(table["muscle"], table["node"], strict=True) if m)
    path.write_text(picked(page, "muscle", [(node, "")]), encoding="utf-8")
    assert read_plan(path).step[-1].muscles == (muscle,)
    save_face(coarse, tmp_path / "face.nc")
    result = CliRunner().invoke(
        app, ["treat", str(path), str(tmp_path / "face.nc"), "--out", str(tmp_path / "treated.nc")]
    )
    assert result.exit_code == 0, result.output


@needs_browser
def test_python_of_nodes_and_elements_and_what_is_absent(coarse, page):
    node = int(skin_of(coarse).node[5])
    space = {"face": coarse}
    text = picked(page, "node", [(node, "")])
    exec(text, space)
    assert space["node"] == node
    text = picked(page, "element", [(node, "")])
    exec(text, space)
    assert node in coarse["connectivity"].values[space["element"]]
    before = len(text.splitlines())
    picked(page, "element", [(10**6, "")])
    said = page.execute_script("return document.getElementById('picked').textContent")
    assert said == "No node of the skin is here."
    page.execute_script("document.getElementById('pick-undo').click()")
    text = page.execute_script("return document.getElementById('pick-text').value")
    assert len(text.splitlines()) == before - 1
    assert not [e for e in page.get_log("browser") if e["level"] == "SEVERE"]


def test_a_face_without_fibres_offers_none(coarse):
    bare = coarse.drop_vars(["fibre_position", "fibre_of_point", "fibre_muscle"])
    picking = pick_data(bare, skin_of(bare))
    assert set(picking["muscle"]) == set(picking["channel"]) == {""}
    json.dumps(picking)

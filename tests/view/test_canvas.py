"""A face is drawn without WebGL as with it: in each pixel, the surface that is nearest."""

import io

import numpy as np
from PIL import Image

from emgface.face.template import template_face
from emgface.pictures.page import face_page
from tests.browser import needs_browser, until

LEFT = "\ue012"


@needs_browser
def test_both_ways_of_drawing_show_the_same(browser, tmp_path):
    """The teeth in an open mouth are behind the lips and in front of the dark, either way.

    Edges, on which the ways may choose the other of two pixels, are 0.7 in 1000 pixels.
    """
    path = tmp_path / "page.html"
    face = template_face(resolution="coarse", measures={"lip_gap": 5e-3})
    path.write_text(face_page(face), encoding="utf-8")
    pictures = []
    for query in ("", "?plain"):
        browser.get(path.as_uri() + query)
        until(browser, "return document.getElementById('stage').dataset.ready === 'yes'")
        stage = browser.find_element("id", "stage")
        stage.send_keys(LEFT * 4)
        png = stage.screenshot_as_png
        pictures.append(np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int))
    assert np.mean(np.abs(pictures[0] - pictures[1]).max(axis=2) > 60) < 1e-3

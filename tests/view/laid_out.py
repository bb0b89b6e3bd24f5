"""Find texts and tables that are cut, and letters without contrast, in a page that a browser shows."""

from pathlib import Path
from typing import Any

FAULTS = (Path(__file__).parent / "laid_out.js").read_text(encoding="utf-8")
WIDTHS = (1400, 900)
SCHEMES = ("light", "dark")


def faults_of(browser: Any) -> dict[str, list[str]]:
    """Faults of the open page by width and colours; the window is as before afterwards."""
    faults_by_page = {}
    for width in WIDTHS:
        metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        for scheme in SCHEMES:
            features = [{"name": "prefers-color-scheme", "value": scheme}]
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
            # Observers of sizes draw once more.
            browser.execute_async_script(
                "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))"
            )
            if faults := browser.execute_script(FAULTS):
                faults_by_page[f"{width}, {scheme}"] = faults
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    return faults_by_page

"""Text of `docs/coupled`: what was simulated, and what each experiment shows."""

from collections.abc import Mapping
from typing import Final

PAGE: Final = """# Experiments with a coupled head

{experiments}
"""
NOTES: Final[Mapping[str, str]] = dict.fromkeys(
    ("stiffening", "shape", "teeth", "closing", "expressions", "coupling", "labials"), ""
)

"""Words used in laboratories for sides, muscles and positions on the face, from ``words.toml``."""

from collections.abc import Mapping
from typing import Final

from emgface.texts import module_toml

_WORDS = module_toml(__file__)


def _by_name(table: str) -> dict[str, tuple[str, ...]]:
    return {name: tuple(words) for name, words in _WORDS[table].items()}


SIDE_WORDS: Final[Mapping[str, str]] = {
    word: side for side, words in _by_name("sides").items() for word in words
}
"""Side, L or R, of a word for it."""
MUSCLE_WORDS: Final[Mapping[str, tuple[str, ...]]] = _by_name("muscles")
"""Words for the muscles that are recorded."""
OTHER_MUSCLES: Final[Mapping[str, tuple[str, ...]]] = _by_name("other_muscles")
"""Words for muscles of the head that the study does not record; the model may move some of them."""
AMBIGUOUS: Final[Mapping[str, str]] = _WORDS["ambiguous"]
"""Words that fit several muscles, with the reason why a label is ambiguous."""
PLACES: Final[Mapping[str, tuple[str, ...]]] = _by_name("places")
"""Words for the places of markers, without side."""
FILLERS: Final = frozenset[str](_WORDS["fillers"])
"""Words that denote neither muscle nor side."""

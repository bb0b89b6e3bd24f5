"""Sentences for a report on the limits of a study of simulated volunteers."""

import xarray as xr

CAN = (
    "A study of simulated volunteers shows whether the chain from recording to score works as it is "
    "written, how much scores depend on its choices, and how they fall where a named assumption of "
    "the method does not hold."
)
CANNOT = (
    "It cannot show how well the method predicts people. sEMG, motion and anatomy come from models "
    "whose parameters were chosen, and what people do otherwise is in none of them. No score of this "
    "report estimates a score with people, and no test of it speaks of people."
)
MATCHED = (
    "In the matched world the volunteers obey the assumptions that the study makes: their motion comes "
    "from the laws of the study's own face, force follows sEMG without delay, electrodes hear what the "
    "mapping of Eqs 2-6 undoes. Scores near 1 are the least to be expected there."
)
REL_MATCHED = (
    "The bursts are drawn from the table of relevant muscles that act_rel is told, and from nothing "
    "else, so that act_rel knows the truth by construction: its lead over the other strategies is no "
    "finding."
)
OTHER = (
    "These volunteers are of the {world}. Each difference from the assumptions of the study has a size "
    "that was chosen, so that scores tell how much such differences cost, and not how large they are in "
    "people."
)
REL_OTHER = (
    "The volunteers' movements still begin from the table of relevant muscles that act_rel is told, "
    "even where persons leave muscles out, add some and weight them otherwise. act_rel keeps an "
    "advantage that people need not give it."
)
UNLABELLED = (
    "The recordings do not say how the volunteers differ from what the study assumes; scores may be "
    "those of a matched world, in which the method is tested against itself."
)


def simulated_limits(cube: xr.Dataset) -> list[str]:
    """Say what simulated recordings can and cannot show.

    Parameters
    ----------
    cube : Dataset
        Attributes ``origin`` and, as simulated volunteers have it, ``world``.

    Returns
    -------
    list of str
        Sentences for a reader; none where recordings were measured.
    """
    if cube.attrs.get("origin") != "simulated":
        return []
    world = str(cube.attrs.get("world", ""))
    told = [CAN, CANNOT]
    if not world:
        return [*told, UNLABELLED]
    matched = world == "matched world"
    told.append(MATCHED if matched else OTHER.format(world=world))
    if "act_rel" in cube["strategy"].values:
        told.append(REL_MATCHED if matched else REL_OTHER)
    return told

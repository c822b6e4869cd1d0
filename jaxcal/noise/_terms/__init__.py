"""Noise terms: one file for each family, each with the closed forms that it has.

A term is an object with one obligation, the density of the samples (`Term.psd`). What it does not override follows from that
density (`_numeric`). Nothing outside of this folder compares names of terms to choose a formula.
"""

from ._base import Block as Block, Term as Term
from ._deterministic import Ramp as Ramp, Sinusoid as Sinusoid
from ._flicker import Flicker as Flicker
from ._markov import GaussMarkov as GaussMarkov
from ._power_law import Filter as Filter, PowerLaw as PowerLaw, Quantisation as Quantisation, RandomWalk as RandomWalk, White as White

#: the terms that have a letter, in the order of every table
BUILT_IN: dict[str, Term] = {term.name: term for term in (Quantisation(), White(), Flicker(), RandomWalk(), Ramp())}

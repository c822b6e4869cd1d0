"""Noise terms: one file for each family, with the closed forms that exist for it.

A term must define the density of its samples (`Term.psd`). All methods that it does not override are computed from that density
(`_numeric`). Code outside of this folder never chooses a formula by the name of a term.
"""

from ._base import Block as Block, Term as Term
from ._deterministic import Ramp as Ramp, Sinusoid as Sinusoid
from ._flicker import Flicker as Flicker
from ._markov import GaussMarkov as GaussMarkov, is_sought as is_sought
from ._power_law import Filter as Filter, PowerLaw as PowerLaw, Quantisation as Quantisation, RandomWalk as RandomWalk, White as White

#: terms that have a letter, in the order of every table
BUILT_IN: dict[str, Term] = {term.name: term for term in (Quantisation(), White(), Flicker(), RandomWalk(), Ramp())}

"""What in a recording is not the sensor under test: knocks, movement, steps, repeated, stuck, zeroed and clipped readings.

It is found once, before any estimate, and for every estimator: `Log.evidence` lists it, and `Log.usable` leaves it out.

Each detector has one statistic and a stated rate of false alarms on records of noise alone, which `benchmarks/evidence.py` measures: at
most 1 % of the records and 0.1 % of the samples.
"""

from ._bursts import bursts as bursts
from ._find import find as find
from ._stretch import Stretch as Stretch

"""Many logs, and logs larger than memory."""

from ._deviation import deviation as deviation

"""Several results of one device on one page: the verdicts in a table, then each result as a part."""

from typing import Any

from .._errors import DataError
from .._log import Log
from ..alignment import AlignmentFit, Readings
from ._html import Markup, inside, join, tag

_BADGES = {"good": " present", "ok": " present", "fitted": " present"}


def pairs(results: Any, log: Any) -> list[tuple[Any, Any]]:
    """Every result with its log: its own where it comes as a pair, else the common one.

    Raises
    ------
    DataError
        If there is none, or a log stands where a result should.
    """
    found = []
    for item in results:
        own = isinstance(item, (list, tuple)) and len(item) == 2
        result, its = item if own else (item, None if isinstance(item, AlignmentFit) else log)
        if isinstance(result, (Log, Readings, list, tuple)):
            raise DataError(f"{type(result).__name__} is not a result; give a list of results, or of pairs (result, log)")
        found.append((result, its))
    if not found:
        raise DataError("there are no results; give at least one, or a list of pairs (result, log)")
    return found


def verdicts(rows: list[tuple[int, str, str, Any]]) -> Markup:
    """The table at the head: part, verdict, what it means."""
    head = tag("tr", *(tag("th", text, scope="col") for text in ("Part", "Verdict", "What was found")))
    body = []
    for number, what, verdict, sentence in rows:
        badge = tag("span", verdict, class_=f"badge{_BADGES.get(verdict, ' hint')}")
        body.append(tag("tr", tag("th", tag("a", what, href=f"#part-{number}"), scope="row"), tag("td", badge), tag("td", sentence)))
    table = tag("table", tag("thead", head), tag("tbody", *body), class_="verdicts")
    return tag("section", tag("h2", "Verdicts", id="verdicts"), table, aria_labelledby="verdicts")


def part(number: int, title: str, lead: str, body: Markup) -> Markup:
    """One result below a heading of its own."""
    name = f"part-{number}"
    head = join((tag("h2", title, id=name), tag("p", lead, class_="lead")))
    return tag("article", head, inside(f"{name}-", body), aria_labelledby=name)

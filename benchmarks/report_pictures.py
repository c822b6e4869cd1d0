"""Take pictures of every report for inspection: 1400 and 390 px wide, light and dark, and as PDF on A4.

    python benchmarks/report_pictures.py FOLDER
    python benchmarks/report_pictures.py FOLDER --only noise mag

Needs Chromium (Debian: apt-get install chromium). The results on the pages are those of the tests. Errors of the pages, and content that
does not fit on them, are printed.
"""

import argparse
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.report import browser, made  # noqa: E402

LOOKS = [(width, scheme, "screen") for width in (1400, 390) for scheme in ("light", "dark")] + [(680, "light", "print")]


def main() -> None:
    """Write a page for every kind of result, and its pictures."""
    from jaxcal.report import write

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--only", nargs="+", choices=made.KINDS, default=list(made.KINDS))
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    script = (ROOT / "tests" / "report" / "look.js").read_text(encoding="utf-8")
    tab = browser.Browser(browser.executable() or sys.exit("no Chromium is installed"))
    try:
        for kind in asked.only:
            page = (asked.folder / f"{kind}.html").resolve()
            result, log = made.KINDS[kind]()
            write(result, page, log=log)
            for width, scheme, media in LOOKS:
                tab.look(width, scheme, media)
                tab.open(page.as_uri())
                tab.run("1")
                tab.picture(asked.folder / f"{kind}-{width}-{scheme}-{media}.png")
                for sentence in [*tab.run(script)["wrong"], *tab.complaints()]:
                    print(f"{kind}, {width} px, {scheme}, {media}: {sentence}")
            (asked.folder / f"{kind}.pdf").write_bytes(tab.paper())
            print(f"{kind}: {page.stat().st_size / 1e3:.0f} kB, {len(LOOKS)} pictures", flush=True)
    finally:
        tab.close()


if __name__ == "__main__":
    main()

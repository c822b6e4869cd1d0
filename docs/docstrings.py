"""An extension of griffe: docstrings of jaxcal, numpydoc whose entries may stand on one line, as Markdown."""

import re

import griffe
import latex2mathml.converter


class Numpydoc(griffe.Extension):
    """Docstrings in numpydoc's sections, whose entries may stand on one line, as Markdown."""

    def on_object(self, *, obj, **kwargs):
        """Rewrite the docstring of one object."""
        if obj.docstring is not None:
            obj.docstring.value = numpydoc(obj.docstring.value)


def numpydoc(text):
    """Markdown of a docstring: sections in bold, entries as lists, examples as code."""
    parts = re.split(r"^([A-Z][A-Za-z ]+)\n-{3,}\n", text, flags=re.MULTILINE)
    out = [_prose(parts[0])]
    for name, body in zip(parts[1::2], parts[2::2], strict=True):
        out.append(f"**{name}**")
        if name == "Examples":
            out.append(_examples(body))
        elif name in ("Parameters", "Attributes", "Raises"):
            out.append(_entries(body))
        else:
            out.append(_prose(body))
    return "\n\n".join(piece for piece in out if piece.strip())


def _entries(body):
    items = re.split(r"\n(?=\S)", body.strip("\n"))
    lines = []
    for item in items:
        first, *rest = item.split("\n")
        found = re.match(r"([\w.*, `]+?) : (.*)", first)
        more = " ".join(line.strip() for line in rest)
        if found:
            names = ", ".join(f"`{name.strip(' `')}`" for name in found[1].split(","))
            lines.append(f"- {names}: {_plain(f'{found[2]} {more}'.strip())}")
        elif rest:
            lines.append(f"- `{first.strip()}`: {_plain(more)}")
        else:
            lines.append(f"- {_plain(first)}")
    return "\n".join(lines)


def _examples(body):
    out = []
    for piece in re.split(r"\n\s*\n", body.strip("\n")):
        if piece.lstrip().startswith((">>>", "...")):
            out.append(f"```pycon\n{piece}\n```")
        elif out and out[-1].startswith("```pycon") and not piece[:1].isupper():
            out[-1] = f"{out[-1][:-4]}\n\n{piece}\n```"
        else:
            out.append(_plain(piece))
    return "\n\n".join(out)


def _prose(text):
    """Paragraphs; what is indented stays as it is."""
    out = []
    text = re.sub(r"^\.\. math::(.*(?:\n(?: +.*|(?=\n +)))*)", lambda found: _formula(found[1]), text, flags=re.MULTILINE)
    for piece in re.split(r"\n\s*\n", text.strip("\n")):
        if piece.startswith('<div class="formula"'):
            out.append(piece)
        elif re.match(r"=+( +=+)+\n", piece) or re.match(r"\s{2,}\S", piece):
            out.append("```text\n" + piece + "\n```")
        elif piece.lstrip().startswith(">>>"):
            out.append(f"```pycon\n{piece}\n```")
        else:
            out.append(_plain(piece))
    return "\n\n".join(out)


def _formula(text):
    return f'<div class="formula">{latex2mathml.converter.convert(" ".join(text.split()), display="block")}</div>'


def _plain(text):
    """Text in which nothing but code in back quotes is Markdown."""
    return "".join(piece if i % 2 else re.sub(r"([*_<\[\]])", r"\\\1", piece) for i, piece in enumerate(re.split(r"(`+[^`]+`+)", text)))

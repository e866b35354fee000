"""The page: sections of text, tables, charts and pictures, as HTML and as Markdown."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TypeAlias


@dataclass(frozen=True)
class Text:
    """A paragraph; `code` in backticks."""

    text: str


@dataclass(frozen=True)
class Alarm:
    """A paragraph that must not be overlooked."""

    text: str


@dataclass(frozen=True)
class Items:
    """A list."""

    items: Sequence[str]


@dataclass(frozen=True)
class Table:
    """The first `texts` columns are text, the others figures.

    Attributes:
        verdicts: index of a column whose words are coloured; None for none.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    texts: int = 1
    verdicts: int | None = None


@dataclass(frozen=True)
class Picture:
    """An image file.

    Attributes:
        name: of the file, without folder.
        caption: below it; also what is read where it is not seen.
    """

    name: str
    data: bytes
    caption: str

    @property
    def mime(self) -> str:
        suffix = self.name.rpartition(".")[2]
        return {"svg": "image/svg+xml", "jpg": "image/jpeg", "png": "image/png"}[suffix]


@dataclass(frozen=True)
class Gallery:
    """Pictures side by side."""

    pictures: Sequence[Picture]
    columns: int = 3


Block: TypeAlias = Text | Alarm | Items | Table | Picture | Gallery


@dataclass(frozen=True)
class Section:
    """A heading and what is below it; `name` is its anchor."""

    name: str
    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)


# What counts as good, middling and bad in a column of verdicts.
_GOOD, _BAD = ("reproduced", "yes"), ("not reproduced", "no")

_STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1.5rem 4rem; max-width: 66rem; background: #fff;
  color: #1f2933; font: 16px/1.55 system-ui, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.3rem; margin: 2.8rem 0 .6rem; padding-top: .5rem; border-top: 2px solid #e4e7eb; }
p, ul { max-width: 52rem; margin: .6rem 0; }
code { font: .88em ui-monospace, "SF Mono", Menlo, Consolas, monospace; background: #f1f4f7;
  padding: .05em .3em; border-radius: 3px; }
nav ol { columns: 2; column-gap: 2.5rem; font-size: .93rem; padding-left: 1.4rem; }
nav a { color: #0b5cad; text-decoration: none; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: .9rem 0; font-size: .89rem; }
th, td { padding: .3rem .7rem; border-bottom: 1px solid #e4e7eb; text-align: right;
  font-variant-numeric: tabular-nums; vertical-align: top; }
td { white-space: nowrap; } td.t { white-space: normal; }
th { border-bottom: 2px solid #9aa5b1; vertical-align: bottom; }
th.t, td.t { text-align: left; }
tbody tr:nth-child(even) { background: #f8fafb; }
td.good, td.part, td.bad { font-weight: 600; white-space: nowrap; }
.good { color: #00664a; } .part { color: #8a5a00; } .bad { color: #a32f00; }
.warning { border: 3px solid #c62828; background: #fdecea; color: #7f1d1d; font-weight: 700;
  padding: .8rem 1rem; max-width: none; }
figure { margin: 1rem 0; } figure img { width: 100%; height: auto; display: block; }
figcaption { font-size: .85rem; color: #52606d; margin-top: .3rem; }
.gallery { display: grid; gap: .9rem; } .gallery figure { margin: 0; }
.gallery img { border: 1px solid #e4e7eb; }
@media (max-width: 40rem) {
  nav ol { columns: 1; }
  .gallery { grid-template-columns: 1fr 1fr !important; }
}
@media print {
  @page { margin: 15mm; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  nav { display: none; }
  h2 { break-after: avoid; margin-top: 1.4rem; }
  figure, tr, .warning { break-inside: avoid; }
  thead { display: table-header-group; }
  table { font-size: 7.5pt; } th, td { padding: .15rem .35rem; }
  .scroll { overflow: visible; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""


def html(title: str, sections: Sequence[Section]) -> str:
    """One file that needs no other, and no script."""
    head, *rest = sections
    entries = "".join(f'<li><a href="#{s.name}">{escape(s.title)}</a></li>' for s in rest)
    body = [f"<h1>{escape(title)}</h1>", *map(_html, head.blocks)]
    body.append(f'<nav aria-label="Contents"><ol>{entries}</ol></nav>')
    for section in rest:
        body.append(f'<section id="{section.name}"><h2>{escape(section.title)}</h2>')
        body += map(_html, section.blocks)
        body.append("</section>")
    text = "\n".join(body)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n<main>\n{text}\n</main>\n</body>\n</html>\n"
    )


def _html(block: Block) -> str:
    match block:
        case Text(text):
            return f"<p>{_inline(text)}</p>"
        case Alarm(text):
            return f'<p class="warning" role="alert">{_inline(text)}</p>'
        case Items(items):
            return "<ul>" + "".join(f"<li>{_inline(item)}</li>" for item in items) + "</ul>"
        case Table():
            return _html_table(block)
        case Picture():
            return _html_picture(block)
        case Gallery(pictures, columns):
            inner = "".join(map(_html_picture, pictures))
            style = f"grid-template-columns: repeat({columns}, 1fr)"
            return f'<div class="gallery" style="{style}">{inner}</div>'


def _html_table(table: Table) -> str:
    def cell(tag: str, index: int, text: str) -> str:
        classes = ["t"] if index < table.texts else []
        if tag == "td" and index == table.verdicts:
            classes.append("good" if text in _GOOD else "bad" if text in _BAD else "part")
        mark = f' class="{" ".join(classes)}"' if classes else ""
        return f"<{tag}{mark}>{_inline(text)}</{tag}>"

    def row(tag: str, texts: Sequence[str]) -> str:
        return "<tr>" + "".join(cell(tag, k, text) for k, text in enumerate(texts)) + "</tr>"

    rows = "\n".join(row("td", texts) for texts in table.rows)
    head = f"<thead>{row('th', table.head)}</thead>"
    return f'<div class="scroll"><table>{head}\n<tbody>{rows}</tbody></table></div>'


def _html_picture(picture: Picture) -> str:
    data = base64.b64encode(picture.data).decode()
    caption = _inline(picture.caption)
    return (
        f'<figure><img alt="{escape(picture.caption)}" src="data:{picture.mime};base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _inline(text: str) -> str:
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def markdown(title: str, sections: Sequence[Section], folder: str) -> str:
    """The same with its images in a folder beside it."""
    head, *rest = sections
    parts = [f"# {title}", *(_markdown(block, folder) for block in head.blocks)]
    for section in rest:
        parts.append(f"## {section.title}")
        parts += [_markdown(block, folder) for block in section.blocks]
    return "\n\n".join(parts) + "\n"


def _markdown(block: Block, folder: str) -> str:
    match block:
        case Text(text):
            return text
        case Alarm(text):
            return f"> **{text}**"
        case Items(items):
            return "\n".join(f"- {item}" for item in items)
        case Table():
            return _markdown_table(block)
        case Picture(name, _, caption):
            return f"![{_plain(caption)}]({folder}/{name})\n\n{caption}"
        case Gallery(pictures, columns):
            return _markdown_gallery(pictures, columns, folder)


def _markdown_gallery(pictures: Sequence[Picture], columns: int, folder: str) -> str:
    """A table: a row of images, a row of their captions, and so on."""
    rows: list[list[str]] = []
    for first in range(0, len(pictures), columns):
        part = pictures[first : first + columns]
        empty = [""] * (columns - len(part))
        rows.append([f"![{_plain(p.caption)}]({folder}/{p.name})" for p in part] + empty)
        rows.append([p.caption for p in part] + empty)
    rows.insert(1, ["---"] * columns)
    return "\n".join(map(_row, rows))


def _markdown_table(table: Table) -> str:
    rule = ["---" if k < table.texts else "---:" for k in range(len(table.head))]
    return "\n".join([_row(table.head), _row(rule), *map(_row, table.rows)])


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _plain(text: str) -> str:
    """Without what ends an image's description."""
    return re.sub(r"[\[\]`]", "", text)

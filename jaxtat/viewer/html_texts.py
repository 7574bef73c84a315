"""Texts of a page as HTML."""

from html import escape


def as_code(command: str) -> str:
    """A command, whose lines end between words only."""
    words = (f"<span style='white-space: nowrap'>{escape(word)}</span>" for word in command.split())
    return f"<code>{' '.join(words)}</code>"


def as_table(rows: list[tuple[str, str, str, str]]) -> str:
    """The choices of an image: what, how much, how sure, why."""
    lines = "".join(f"<tr>{''.join(map(_cell, line))}</tr>" for line in rows)
    return f"<b>What was chosen, and why</b><table>{lines}</table>"


def as_title(name: str, about: str) -> str:
    """The name of a scan, and what is said of it."""
    return f"<b style='font-size:1.3em'>{escape(name)}</b><br>{about}"


def as_error(error: str) -> str:
    """A line that says what went wrong."""
    return f"<span style='color:#c0392b'>{escape(error)}</span>"


def _cell(text: str) -> str:
    return f"<td style='padding: 1px 14px 1px 0'>{escape(text)}</td>"

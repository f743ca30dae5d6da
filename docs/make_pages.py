#!/usr/bin/env python3
"""Writes docs/commands.md, or man pages, from what `camber --help` and `camber COMMAND --help` print.

  docs/make_pages.py PROGRAM --markdown docs/commands.md
  docs/make_pages.py PROGRAM --man FOLDER          camber.1, camber-plane.1, ...
  docs/make_pages.py PROGRAM --check docs/commands.md   exit code 1 if the file is another
"""

import argparse
import os
import re
import subprocess
import sys


class Page:
    """One --help text, in its parts."""

    def __init__(self, program, words):
        self.words = words
        text = subprocess.run(
            [program, *words, "--help"], check=True, capture_output=True, text=True
        ).stdout
        self.summary, self.usage, self.examples = "", "", []
        self.sections = {}  # name -> [(what, text)]
        section = None
        for line in text.split("\n"):
            if line.startswith("Usage: "):
                self.usage = line[len("Usage: ") :]
            elif re.fullmatch(r"[A-Z][a-z]+:", line):
                section = line[:-1]
                if section != "Examples":
                    self.sections[section] = []
            elif section == "Examples":
                if line.strip():
                    self.examples.append(line[2:] if line.startswith("  ") else line)
            elif section and line.startswith("  "):
                self._entry(self.sections[section], line)
            elif not section and line.strip():
                self.summary += (" " if self.summary else "") + line.strip()

    @staticmethod
    def _entry(entries, line):
        """A line of a section: a new entry, or the text of the last one. Text begins at column 30."""
        if line.startswith(" " * 10):
            what, text = entries.pop()
            entries.append((what, (text + " " + line.strip()).strip()))
            return
        parts = re.split(r" {2,}", line.strip(), maxsplit=1)
        what = line[:29].strip()
        # Not where the column falls into an option's own range or list of others.
        whole = what.count("[") == what.count("]") and not what.endswith(":")
        whole = whole and not line[30:].startswith("in [")
        if len(parts) == 1 and len(line) > 30 and line[29] == " " and whole:
            parts = [what, line[30:].strip()]
        entries.append((parts[0], parts[1] if len(parts) > 1 else ""))

    def commands(self):
        return [what for what, _ in self.sections.get("Subcommands", [])]


def all_pages(program, words=()):
    """The page of the program or a command, then those of the commands below it."""
    page = Page(program, list(words))
    pages = [page]
    for name in page.commands():
        pages += all_pages(program, [*words, name])
    return pages


COMMON = ("-h,--help", "--seed", "--threads", "--quiet", "--config", "--print-config")


def is_common(what):
    return what.split()[0] in COMMON


def cell(text):
    return text.replace("|", "\\|").replace("<", "&lt;")


def markdown(pages):
    root, rest = pages[0], pages[1:]
    out = [
        "# Commands",
        "",
        "Made from `--help` by `docs/make_pages.py`; a test holds it to that. Exit codes, units and"
        " frames: [conventions.md](conventions.md); files: [formats.md](formats.md).",
        "",
        "| command | does |",
        "|---|---|",
    ]
    out += [f"| `camber {what}` | {cell(text)} |" for what, text in root.sections["Subcommands"]]
    common_page = next(p for p in rest if p.sections.get("Options") and not p.commands())
    common = [e for e in common_page.sections["Options"] if is_common(e[0])]
    out += ["", "Every command takes", "", "| option | |", "|---|---|"]
    out += [f"| `{what}` | {cell(text)} |" for what, text in common]
    for page in rest:
        out += ["", f"## camber {' '.join(page.words)}", "", page.summary, ""]
        if page.commands():
            entries = page.sections["Subcommands"]
            out += ["| command | does |", "|---|---|"]
            out += [
                f"| `camber {' '.join(page.words)} {what}` | {cell(text)} |" for what, text in entries
            ]
            continue
        entries = page.sections.get("Positionals", []) + [
            e for e in page.sections.get("Options", []) if e not in common
        ]
        if entries:
            out += ["| argument | |", "|---|---|"]
            out += [f"| `{what}` | {cell(text)} |" for what, text in entries]
        if page.examples:
            out += ["", "```sh", *page.examples, "```"]
    return "\n".join(out) + "\n"


def roff(text):
    """Text that troff prints as it is."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text.startswith((".", "'")) else text


def man_page(page, version):
    name = "-".join(["camber", *page.words])
    summary = page.summary.split(". ")[0].rstrip(".")
    out = [
        f'.TH "{name.upper()}" "1" "" "camber {version}" "User Commands"',
        ".SH NAME",
        f"{roff(name)} \\- {roff(summary)}",
        ".SH SYNOPSIS",
        ".B " + roff(page.usage),
        ".SH DESCRIPTION",
        roff(page.summary),
    ]
    titles = {"Positionals": "ARGUMENTS", "Options": "OPTIONS", "Subcommands": "COMMANDS"}
    for section, entries in page.sections.items():
        out.append(".SH " + titles.get(section, section.upper()))
        for what, text in entries:
            out += [".TP", ".B " + roff(what), roff(text)]
    if page.examples:
        out += [".SH EXAMPLES", ".nf", *[roff(line) for line in page.examples], ".fi"]
    out += [
        ".SH EXIT STATUS",
        "0: done. 1: the input is sound but cannot answer. 2: bad usage or bad input. 3: the machine"
        " refuses. 130: interrupted.",
    ]
    return "\n".join(out) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--markdown", metavar="FILE")
    action.add_argument("--man", metavar="FOLDER")
    action.add_argument("--check", metavar="FILE")
    args = parser.parse_args()
    program = os.path.abspath(args.program)
    pages = all_pages(program)
    if args.man:
        version = subprocess.run(
            [program, "--version"], check=True, capture_output=True, text=True
        ).stdout.split()[1]
        os.makedirs(args.man, exist_ok=True)
        for page in pages:
            path = os.path.join(args.man, "-".join(["camber", *page.words]) + ".1")
            with open(path, "w", encoding="utf-8") as out:
                out.write(man_page(page, version))
        return 0
    text = markdown(pages)
    if args.markdown:
        with open(args.markdown, "w", encoding="utf-8") as out:
            out.write(text)
        return 0
    with open(args.check, encoding="utf-8") as found:
        lines = found.read().split("\n")
    for number, (have, want) in enumerate(zip(lines + [""], text.split("\n") + [""]), start=1):
        if have != want:
            print(
                f"{args.check}:{number}: found '{have}', expected '{want}';"
                f" run docs/make_pages.py PROGRAM --markdown {args.check}",
                file=sys.stderr,
            )
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""Makes the Python module's docstrings of the C++ headers' comments.

  make_docstrings.py HEADER... --out docstrings.h

Each struct, field and function of namespace camber becomes a constant: kDoc_PlaneFit,
kDoc_PlaneFit_rmse, kDoc_fit_plane. A name that the module asks for and no header declares does not
compile.
"""

import argparse
import re
import sys

OPENS = re.compile(r"^(?:struct|class|enum class)\s+(\w+)[^;]*\{")
FUNCTION = re.compile(r"\b(\w+)\s*\(")
WORDS = [
    (re.compile(r"std::invalid_argument"), "ValueError"),
    (re.compile(r"std::vector"), "list"),
    (re.compile(r"@param\s+(\w+)"), r":param \1:"),
    (re.compile(r"@returns?\b"), ":return:"),
    (re.compile(r"@throws\s+(\w+)"), r":raises \1:"),
    (re.compile(r"\bnullptr\b|\bstd::nullopt\b"), "None"),
    (re.compile(r"\bnum_threads\b"), "threads"),
]
ENUMERATOR = re.compile(r"\bk([A-Z][A-Za-z]+)\b")


def to_python(text):
    """A comment in Python's words: enumerators are strings, exceptions have Python's names."""
    for pattern, word in WORDS:
        text = pattern.sub(word, text)
    snake = lambda m: "'" + re.sub(r"(?<=[a-z])(?=[A-Z])", "_", m.group(1)).lower() + "'"
    return ENUMERATOR.sub(snake, text).strip()


def declared_names(code):
    """The names that a declaration declares: a function's or those of fields."""
    while "<" in code and (inner := re.sub(r"<[^<>()]*>", "", code)) != code:
        code = inner
    before = re.split(r"[={]", code)[0]  # initialisers may call functions
    function = FUNCTION.search(before)
    if function:
        return [function.group(1)]
    code = re.sub(r"\([^()]*\)|\{[^{}]*\}", "", code)
    code = re.sub(r"=[^,;]*", "", code)
    if not code.rstrip().endswith(";"):
        return []
    names = [part.split()[-1] for part in code.strip(" ;").split(",") if part.split()]
    return [name for name in names if name.isidentifier()]


def comments(lines):
    """Yields (name, comment) of everything that the lines of a header declare."""
    structs, above, behind, begun = [], [], [], ""
    for line in lines:
        text = line.strip()
        if text.startswith("///<"):
            for item in behind:
                item[1].append(text[4:].strip())
            continue
        yield from ((name, " ".join(words)) for name, words in behind)
        behind = []
        if text.startswith("///"):
            above.append(text[3:].removeprefix(" "))
            continue
        code, _, trailing = text.partition("///<")
        if text.startswith(("//", "#", "}")) or not text:
            if text.startswith("};") and structs:
                structs.pop()
            above, begun = [], ""
            continue
        begun = f"{begun} {code.partition('//')[0].strip()}".strip()
        opened = OPENS.match(begun)
        if not opened and not trailing and not begun.endswith((";", "{", "}")):
            continue  # goes on in the next line
        names = [opened.group(1)] if opened else declared_names(begun)
        for name in names if names and not begun.startswith("return") else []:
            full = "_".join(structs + [name])
            if trailing:
                behind.append((full, [trailing.strip()]))
            else:
                yield full, "\n".join(above)
        if opened and "};" not in begun:
            structs.append(opened.group(1))
        above, begun = [], ""
    yield from ((name, " ".join(words)) for name, words in behind)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("headers", nargs="+")
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    found = {}
    for header in arguments.headers:
        with open(header, encoding="utf-8") as file:
            for name, comment in comments(file.read().splitlines()):
                found[name] = found.get(name) or comment  # overloads: the first
    with open(arguments.out, "w", encoding="utf-8") as out:
        out.write("// Made by make_docstrings.py.\n#pragma once\n")
        for name in sorted(found):
            text = to_python(found[name])
            if ')doc"' in text:
                sys.exit(f"make_docstrings.py: {name}: the comment holds a delimiter")
            out.write(f'inline constexpr char kDoc_{name}[] = R"doc({text})doc";\n')


if __name__ == "__main__":
    main()

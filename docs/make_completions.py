#!/usr/bin/env python3
"""Writes what bash, zsh and fish need to complete camber's command line, made of its --help.

  docs/make_completions.py PROGRAM --bash FILE --zsh FILE --fish FILE
"""

import argparse
import os
import re
import textwrap

from make_pages import all_pages


class Option:
    """One option of a command: its names, whether a value follows, and which ones there are."""

    def __init__(self, what, text):
        names, _, rest = what.partition(" ")
        self.names = names.split(",")
        self.long = [name for name in self.names if name.startswith("--")][0]
        self.takes_value = re.match(r"(TEXT|INT|UINT|FLOAT|NUMBER|LIST)\b", rest) is not None
        choices = re.search(r"\{([^}]*)\}", rest)
        self.choices = choices.group(1).split(",") if choices else []
        self.text = textwrap.shorten(text, 70, placeholder=" ...")


class Command:
    def __init__(self, page):
        self.words = ["camber", *page.words]
        self.path = " ".join(self.words)
        self.options = [Option(*entry) for entry in page.sections.get("Options", [])]
        self.commands = page.sections.get("Subcommands", [])


def bash(commands):
    out = [
        "# Completion of camber for bash. Made by docs/make_completions.py.",
        "_camber() {",
        "  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]}",
        "  local command=camber words= word",
        '  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do',
        '    case "$command $word" in',
        "      " + " | ".join(f'"{c.path}"' for c in commands[1:]) + ') command="$command $word" ;;',
        "    esac",
        "  done",
        "  COMPREPLY=()",
        '  case "$command $previous" in',
    ]
    for command in commands:
        for option in (o for o in command.options if o.takes_value):
            patterns = " | ".join(f'"{command.path} {name}"' for name in option.names)
            if option.choices:
                out += [f"    {patterns})",
                        f'      COMPREPLY=($(compgen -W "{" ".join(option.choices)}" -- "$current"))',
                        "      return ;;"]
            else:  # a number, or a file by the shell's own completion
                out.append(f"    {patterns}) return ;;")
    out += ["  esac", '  case "$command" in']
    for command in commands:
        options = " ".join(option.long for option in command.options)
        below = " ".join(name for name, _ in command.commands)
        out += [f'    "{command.path}")',
                f'      if [[ $current == -* ]]; then words="{options}"; else words="{below}"; fi ;;']
    out += ["  esac", '  COMPREPLY=($(compgen -W "$words" -- "$current"))', "}",
            "complete -o bashdefault -o default -F _camber camber"]
    return "\n".join(out) + "\n"


def quoted(text):
    return "'" + text.replace("'", "'\\''") + "'"


def zsh(commands):
    def function(command):
        return "_" + "_".join(command.words).replace("-", "_")

    out = ["#compdef camber", "# Completion of camber for zsh. Made by docs/make_completions.py."]
    escape = lambda text: re.sub(r"([\[\]:\\])", r"\\\1", text)
    for command in reversed(commands):
        out += ["", function(command) + "() {", "  local -a line state", "  _arguments -C \\"]
        for option in command.options:
            text = f"[{escape(option.text)}]"
            value = ""
            if option.choices:
                value = f":value:({' '.join(option.choices)})"
            elif option.takes_value:
                value = ":value:_files"
            out.append(f"    {quoted(option.long + text + value)} \\")
        if not command.commands:
            out += ["    '*:file:_files'", "}"]
            continue
        listed = " ".join(f"{name}\\:{quoted(escape(text))}" for name, text in command.commands)
        out += [f"    {quoted(f'1:command:(({listed}))')} \\", "    '*::argument:->rest'",
                "  case $state in", "    rest)", "      case $line[1] in"]
        for below in commands:
            if below.words[:-1] == command.words:
                out.append(f"        {below.words[-1]}) {function(below)} ;;")
        out += ["      esac ;;", "  esac", "}"]
    return "\n".join(out + ["", '_camber "$@"']) + "\n"


def fish(commands):
    out = ["# Completion of camber for fish. Made by docs/make_completions.py."]
    for command in commands:
        below = " ".join(name for name, _ in command.commands)
        seen = [f"__fish_seen_subcommand_from {word}" for word in command.words[1:]]
        # Not one of its own commands, nor the command of another of the same name (prior info).
        others = [c.words[1] for c in commands
                  if len(command.words) == 2 and c.words[2:] == command.words[1:]]
        seen += [f"not __fish_seen_subcommand_from {names}"
                 for names in (below, " ".join(others)) if names]
        condition = "; and ".join(seen) or "true"
        for name, text in command.commands:
            out.append(f"complete -c camber -f -n {quoted(condition)} -a {name} -d {quoted(text)}")
        for option in command.options:
            line = f"complete -c camber -n {quoted(condition)} -l {option.long[2:]}"
            for name in option.names:
                if not name.startswith("--"):
                    line += f" -s {name[1:]}"
            if option.choices:
                line += f" -x -a {quoted(' '.join(option.choices))}"
            elif option.takes_value:
                line += " -r"
            out.append(f"{line} -d {quoted(option.text)}")
    return "\n".join(out) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    shells = {"bash": bash, "zsh": zsh, "fish": fish}
    for shell in shells:
        parser.add_argument(f"--{shell}", metavar="FILE")
    args = parser.parse_args()
    commands = [Command(page) for page in all_pages(os.path.abspath(args.program))]
    for shell, write in shells.items():
        path = getattr(args, shell)
        if path:
            os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
            with open(path, "w", encoding="utf-8") as out:
                out.write(write(commands))


if __name__ == "__main__":
    main()

#!/usr/bin/env bash
# The completion for bash, asked as the shell asks it; those for zsh and fish, read by their shells
# where they are installed.
#   completion_test.sh PROGRAM MAKE_COMPLETIONS WORK_FOLDER
set -euo pipefail
python3 -B "$2" "$1" --bash "$3/camber" --zsh "$3/_camber" --fish "$3/camber.fish"
source "$3/camber"
expect() { # WORDS... = ANSWER
  local words=() answer
  while [ "$1" != = ]; do words+=("$1"); shift; done
  answer=$2
  COMP_WORDS=("${words[@]}") COMP_CWORD=$((${#words[@]} - 1))
  _camber || true
  if [ "${COMPREPLY[*]}" != "$answer" ]; then
    printf 'after "%s": found "%s", expected "%s"\n' "${words[*]}" "${COMPREPLY[*]}" "$answer" >&2
    exit 1
  fi
}
expect camber rec = reconstruct
expect camber import v = video
expect camber reconstruct scene --meth = --method
expect camber reconstruct scene --method "" = "joint coplanar flat reprojection"
expect camber reconstruct scene --method co = coplanar
expect camber plane --out "" = ""
expect camber plane --no-such = ""
complete -p camber | grep -q -- "-o default" # files, where there are no words
# What describes commands is no command line: zsh's functions as far as bash reads them, asked for
# what they hand to _arguments.
described=$(
  _arguments() { printf '%s\n' "$@"; }
  set +eu
  source "$3/_camber" >/dev/null
  _camber_keypoints
  _camber_render
)
grep -q "\`keypoints synthesise\`" <<<"$described"
grep -q -- "^--show\[.*\]:value:_files" <<<"$described" # a list is a value
# What 'camber info' takes is not for 'camber prior info'.
grep -- "-l lenient " "$3/camber.fish" | grep "_from info;" | grep -q "not __fish_seen_subcommand_from prior"
if command -v zsh >/dev/null; then zsh -n "$3/_camber"; fi
if command -v fish >/dev/null; then
  fish --no-execute "$3/camber.fish"
  answer=$(fish -c "source $3/camber.fish; complete --do-complete 'camber reconstruct scene --method '")
  grep -q "^coplanar" <<<"$answer"
  answer=$(fish -c "source $3/camber.fish; complete --do-complete 'camber rec'")
  grep -q "^reconstruct" <<<"$answer"
  answer=$(fish -c "source $3/camber.fish; complete --do-complete 'camber prior info --l'")
  [ -z "$answer" ]
fi

#include "run_verb.h"

#include <glog/logging.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <cstring>
#include <exception>

#include "../own_inputs.h"
#include "../signals.h"
#include "../standard_streams.h"
#include "camber/core/default_threads.h"
#include "camber/core/errors.h"
#include "camber/scene/input_kind.h"

namespace camber::tools {
namespace {

int report(const std::exception& error) {
  // Whatever an interrupted computation ran into: it was interrupted.
  if (ends_interrupted()) return report_failure(InterruptedError());
  // The message of who printed names no file.
  return std::ferror(stdout) ? finish_standard_output(0) : report_failure(error);
}

}  // namespace

namespace {

/// A word as a shell takes it: in quotes where it holds more than letters, digits and a few signs.
std::string shell_word(const std::string& word) {
  const auto plain = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) || std::strchr("_-./:=,+@%", c);
  };
  if (!word.empty() && std::all_of(word.begin(), word.end(), plain)) return word;
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

/// `camber import drive.mp4` as `camber import video drive.mp4`: the kind by what the word names.
std::vector<char*> with_kind_of_import(int argc, char** argv, std::string* kind) {
  std::vector<char*> words(argv, argv + argc);
  if (argc < 3 || std::strcmp(argv[1], "import") != 0) return words;
  // A kind that is named is no guess, also where a folder has its name.
  for (const char* named : {"images", "video", "rosbag", "kitti", "synthia-sf", "colmap"}) {
    if (std::strcmp(argv[2], named) == 0) return words;
  }
  const InputKind guessed = kind_of_input(argv[2]);
  if (guessed == InputKind::kScene) return words;
  *kind = to_string(guessed);
  words.insert(words.begin() + 2, kind->data());
  return words;
}

}  // namespace

int run_verb(int typed_count, char** typed,
             const std::vector<std::pair<std::string, void (*)(App&)>>& verbs) {
  std::string kind;
  std::vector<char*> words = with_kind_of_import(typed_count, typed, &kind);
  const int argc = static_cast<int>(words.size());
  char** argv = words.data();
  watch_signals();
  watch_failures();
  // Ceres logs trial steps that fail; our statuses hold the outcome.
  FLAGS_minloglevel = google::GLOG_FATAL;

  try {
    App root("", "camber");
    root.require_subcommand();
    for (const auto& [name, register_in] : verbs) {
      if (name == argv[1]) register_in(root);
    }
    const int done = root.parse(argc, argv);
    if (done >= 0) return done;

    std::string command_line = "camber";
    for (int i = 1; i < argc; ++i) command_line += " " + shell_word(argv[i]);
    if (!kind.empty()) {
      std::fprintf(stderr, "camber: %s is taken for: camber import %s\n",
                   one_line(typed[2]).c_str(), kind.c_str());
    }
    Command* command = parsed_command();
    command->common.command_line = command_line;
    refuse_own_inputs(*command);
    set_default_num_threads(command->common.threads);
    const int exit_code = command->run();
    ends_interrupted();  // done: a signal from now on changes nothing
    return exit_code;
  } catch (const std::exception& error) {
    return report(error);
  }
}

}  // namespace camber::tools

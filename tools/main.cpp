// The camber program's front: finds the command, loads the plugin that holds it, and hands over.

#include <dlfcn.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

#include "camber/core/version.h"
#include "huge_pages.h"
#include "libraries.h"
#include "nearest_name.h"
#include "plugins/plugin.h"
#include "standard_streams.h"
#include "verbs.h"

namespace camber::tools {
namespace {

std::string list_of_verbs() {
  std::string text;
  for (const Verb& verb : kVerbs) {
    const std::string name = verb.name;
    text += "  " + name + std::string(name.size() < 28 ? 28 - name.size() : 1, ' ') + verb.summary +
            "\n";
  }
  return text;
}

void print_help() {
  std::printf(
      "Camber: metric road surfaces and vehicles from one moving camera\n"
      "Usage: camber [OPTIONS] SUBCOMMAND\n\n"
      "Options:\n"
      "  -h,--help                   Print this help message and exit\n"
      "  --version                   Display program version information and exit;\n"
      "                              --version --json also names the libraries\n\n"
      "Subcommands:\n%s\n"
      "camber COMMAND --help shows the options of one.\n",
      list_of_verbs().c_str());
}

/// The sentence about a first word that is no command; where there is none, the list of commands.
int misused(const std::string& word) {
  std::vector<std::string> names;
  const bool option = !word.empty() && word[0] == '-';
  if (option) {
    names = {"--help", "--version"};
  } else {
    for (const Verb& verb : kVerbs) names.emplace_back(verb.name);
  }
  const std::string meant = nearest_name(word, names);
  std::string text = "a command is required";
  if (!word.empty()) {
    text = std::string("there is no ") + (option ? "option " : "command ") + word;
    text += meant.empty() ? "; camber --help lists what there is" : ": did you mean " + meant + "?";
  }
  std::fprintf(stderr, "camber: %s\n", one_line(text).c_str());
  if (word.empty()) std::fprintf(stderr, "The commands are\n%s", list_of_verbs().c_str());
  return 2;
}

/// @param word after --version.
int print_version(const std::string& word) {
  if (word.empty()) {
    std::printf("camber %s\n", kVersion);
    return 0;
  }
  if (word != "--json") {
    std::fprintf(stderr, "camber: found %s after --version, expected --json or nothing\n",
                 one_line(word).c_str());
    return 2;
  }
  std::printf("{\n  \"version\": \"%s\",\n  \"compiler\": \"%s\",\n  \"libraries\": {", kVersion,
              kCompiler);
  const char* separator = "";
  for (const Library& library : kLibraries) {
    std::printf("%s\n    \"%s\": \"%s\"", separator, library.name, library.version);
    separator = ",";
  }
  std::printf("\n  }\n}\n");
  return 0;
}

int run(int argc, char** argv) {
  const std::string word = argc > 1 ? argv[1] : "";
  if (word == "--version") return print_version(argc > 2 ? argv[2] : "");
  if (word == "-h" || word == "--help") {
    print_help();
    return 0;
  }
  for (const Verb& verb : kVerbs) {
    if (word != verb.name) continue;
    const bool asks =
        argc < 3 || std::strcmp(argv[2], "--help") == 0 || std::strcmp(argv[2], "-h") == 0;
    if (!asks) start_with_huge_pages(argv);
    using Run = int (*)(int, char**);
    return reinterpret_cast<Run>(plugin_symbol(verb.plugin, "camber_run"))(argc, argv);
  }
  return misused(word);
}

}  // namespace
}  // namespace camber::tools

#if defined(__SANITIZE_ADDRESS__)
/// Asked at the end. Mesa and OpenCV's networks keep memory in threads that are not yet gone, on
/// which the search for leaks crashes.
extern "C" int __lsan_is_turned_off();
extern "C" int __lsan_is_turned_off() {
  for (const char* library : {"libEGL.so.1", "libopencv_dnn.so.406"}) {
    if (::dlopen(library, RTLD_NOLOAD | RTLD_LAZY)) return 1;
  }
  return 0;
}
#endif

/// Stands before the standard library's for all shared objects: those of Fortran and OpenMP end the
/// program themselves, each with a code of its own, where they have no memory while they are
/// loaded.
extern "C" [[noreturn]] __attribute__((visibility("default"))) void exit(int) noexcept {
  constexpr char kSentence[] =
      "camber: a library ended the program, most likely for want of memory\n";
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, kSentence, sizeof(kSentence) - 1);
  std::_Exit(3);
}

int main(int argc, char** argv) {
  using namespace camber::tools;
  std::set_terminate([] {  // a plugin has a better one
    std::fputs("camber: out of memory\n", stderr);
    std::_Exit(3);
  });
  try {
    open_standard_streams();
    return finish_standard_output(run(argc, argv));
  } catch (const std::exception& error) {
    return report_failure(error);
  }
}

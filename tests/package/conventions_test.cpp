// What every command of the program has in common: help with examples to paste, the common options,
// exit codes for bad usage; and that the documents say what the program says.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "camber/core/version.h"
#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::read_text;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

namespace {

struct Outcome {
  int exit_code = -1;
  std::string out, err;
};

/// Runs the program in an empty folder with arguments for the shell.
Outcome run_camber(const std::string& arguments) {
  const camber::test::TemporaryFolder folder;
  const fs::path out = folder.path() / "out", err = folder.path() / "err";
  const fs::path work = folder.path() / "work";
  fs::create_directory(work);
  const std::string command = "cd '" + work.string() + "' && '" CAMBER_PROGRAM "' " + arguments +
                              " >'" + out.string() + "' 2>'" + err.string() + "' </dev/null";
  const int status = std::system(command.c_str());
  EXPECT_TRUE(WIFEXITED(status)) << arguments << " was killed";
  EXPECT_TRUE(fs::is_empty(work)) << arguments << " left files behind";
  return {WEXITSTATUS(status), read_text(out), read_text(err)};
}

/// The names below "Subcommands:" in a help text.
std::vector<std::string> subcommands_of(const std::string& help) {
  std::vector<std::string> names;
  std::istringstream lines(help);
  std::string line;
  bool inside = false;
  while (std::getline(lines, line)) {
    if (line == "Subcommands:") {
      inside = true;
    } else if (inside) {
      static const std::regex entry("^  ([a-z][a-z0-9-]*)( .*)?$");
      std::smatch match;
      if (std::regex_match(line, match, entry)) {
        names.push_back(match[1]);
      } else if (line.empty() || line[0] != ' ') {
        break;
      }
    }
  }
  return names;
}

/// What a command prints for --help, asked for once a process. @param command  empty: the program.
const Outcome& help_of(const std::string& command) {
  static std::map<std::string, Outcome> all;
  const auto [at, is_new] = all.try_emplace(command);
  if (is_new) at->second = run_camber(command + " --help");
  return at->second;
}

/// Every command below one, with its own subcommands: "info", "import kitti".
std::vector<std::string> commands_below(const std::string& above) {
  std::vector<std::string> commands;
  for (const std::string& name : subcommands_of(help_of(above).out)) {
    const std::string command = above + (above.empty() ? "" : " ") + name;
    const std::vector<std::string> below = commands_below(command);
    if (below.empty()) {
      commands.push_back(command);
    } else {
      commands.insert(commands.end(), below.begin(), below.end());
    }
  }
  return commands;
}

std::vector<std::string> all_commands() { return commands_below(""); }

/// " --out NAME" with an extension that the help of --out names, or nothing without such an option.
std::string out_argument(const std::string& help) {
  static const std::regex option(R"(\n  --out .*(?:\n {20,}.*)*)");
  static const std::regex extension(R"([.](ply|pcd|png|json|csv)\b)");
  std::smatch text, name;
  if (!std::regex_search(help, text, option)) return "";
  const std::string description = text.str();
  return std::regex_search(description, name, extension) ? " --out x" + name.str() : " --out x";
}

TEST(Program, SaysItsVersion) {
  const Outcome outcome = run_camber("--version");
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(outcome.out, std::string("camber ") + camber::kVersion + "\n");
  EXPECT_EQ(outcome.err, "");
}

TEST(Program, ExplainsItself) {
  const Outcome outcome = run_camber("--help");
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_THAT(outcome.out, HasSubstr("Subcommands:"));
  EXPECT_EQ(outcome.err, "");
}

TEST(Program, NeedsACommandThatExists) {
  for (const char* arguments : {"", "no-such-command", "--no-such-option"}) {
    const Outcome outcome = run_camber(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << arguments;
    EXPECT_EQ(outcome.out, "") << arguments;
    EXPECT_THAT(outcome.err, StartsWith("camber: ")) << arguments;
  }
}

TEST(Program, ListsTheCommandsWhereNoneIsGiven) {
  const std::string help = run_camber("--help").out;
  const Outcome outcome = run_camber("");
  EXPECT_EQ(outcome.exit_code, 2);
  for (const std::string& command : subcommands_of(help)) {
    EXPECT_THAT(outcome.err, HasSubstr("\n  " + command + " "));
  }
}

TEST(Program, NamesItsLibraries) {
  const Outcome outcome = run_camber("--version --json");
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_THAT(outcome.out, StartsWith("{\n  \"version\": \"" + std::string(camber::kVersion)));
  for (const char* library : {"Ceres", "CLI11", "Eigen", "OpenCV", "PCL", "PROJ", "VTK"}) {
    EXPECT_TRUE(std::regex_search(
        outcome.out, std::regex("    \"" + std::string(library) + "\": \"[0-9]+[.][0-9.]+\"")))
        << library;
  }
  EXPECT_EQ(run_camber("--version --xml").exit_code, 2);
}

TEST(Program, NamesTheNearestOfAMisspeltName) {
  const std::pair<const char*, const char*> cases[] = {
      {"reconstrcut", "there is no command reconstrcut: did you mean reconstruct?"},
      {"recon", "there is no command recon: did you mean reconstruct?"},
      {"Plane", "there is no command Plane: did you mean plane?"},
      {"--verson", "there is no option --verson: did you mean --version?"},
      {"import kiti", "found kiti: did you mean kitti?"},
      {"plane x.ply --thresold 0.1", "found --thresold: did you mean --threshold?"},
      {"plane x.ply --thresold=0.1", "found --thresold: did you mean --threshold?"},
      // The option that is missing is the one that is misspelt.
      {"reconstruct x --uot y", "--out is required; found --uot: did you mean --out?"},
  };
  for (const auto& [arguments, expected] : cases) {
    SCOPED_TRACE(arguments);
    const Outcome outcome = run_camber(arguments);
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_EQ(outcome.out, "");
    EXPECT_THAT(outcome.err, StartsWith("camber: "));
    EXPECT_THAT(outcome.err, testing::EndsWith(std::string(expected) + "\n"));
  }
  EXPECT_THAT(run_camber("plane x.ply --zzzzzz").err, testing::Not(HasSubstr("did you mean")));
  EXPECT_THAT(run_camber("import").err,
              HasSubstr("; expected images, video, colmap, rosbag, kitti or synthia-sf\n"));
}

TEST(EveryCommand, HasHelpWithExamplesThatNameItsOptions) {
  const std::vector<std::string> commands = all_commands();
  ASSERT_FALSE(commands.empty());
  for (const std::string& command : commands) {
    SCOPED_TRACE(command);
    const Outcome& outcome = help_of(command);
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_EQ(outcome.err, "");
    const auto examples = outcome.out.find("Examples:\n");
    ASSERT_NE(examples, std::string::npos);
    const std::string options = outcome.out.substr(0, examples);
    EXPECT_THAT(outcome.out.substr(examples), HasSubstr("camber " + command + " "));
    const std::string text = outcome.out.substr(examples);
    static const std::regex option("--[a-z][a-z0-9-]*");
    for (std::sregex_iterator at(text.begin(), text.end(), option), end; at != end; ++at) {
      EXPECT_THAT(options, HasSubstr(at->str())) << "the examples use an option that is not there";
    }
  }
}

TEST(EveryCommand, TakesTheCommonOptions) {
  for (const std::string& command : all_commands()) {
    SCOPED_TRACE(command);
    const std::string& help = help_of(command).out;
    for (const char* option : {"--seed", "--threads", "--quiet", "--config", "--print-config"}) {
      EXPECT_THAT(help, HasSubstr(option));
    }
  }
}

// What --print-config prints is a configuration that prints the same again.
TEST(EveryCommand, PrintsItsConfigurationAndTakesItBack) {
  const camber::test::TemporaryFolder folder;
  const std::string file = (folder.path() / "config.toml").string();
  for (const std::string& command : all_commands()) {
    SCOPED_TRACE(command);
    const Outcome printed = run_camber(command + " --threads 3 --print-config");
    EXPECT_EQ(printed.exit_code, 0) << printed.err;
    EXPECT_THAT(printed.out, StartsWith("[" + std::regex_replace(command, std::regex(" "), ".")));
    EXPECT_THAT(printed.out, HasSubstr("\nthreads = 3\n"));
    std::ofstream(file) << printed.out;
    const Outcome again = run_camber(command + " --print-config --config '" + file + "'");
    EXPECT_EQ(again.exit_code, 0) << again.err;
    EXPECT_EQ(again.out, printed.out);
  }
}

class Configuration : public testing::Test {
 protected:
  Outcome run(const std::string& content, const std::string& arguments) {
    std::ofstream(file_) << content;
    return run_camber("plane " + road_ + " --config '" + file_ + "' " + arguments);
  }
  camber::test::TemporaryFolder folder_;
  std::string file_ = (folder_.path() / "config.toml").string();
  std::string road_ =
      "'" + (camber::test::source_dir() / "samples/steep_hill/truth/road.ply").string() + "'";
};

TEST_F(Configuration, StandsForWhatTheLineLeavesOpen) {
  const std::string content =
      "threads = 1\n# a comment\n[plane]\nthreshold = 7e-2\nup = [0, -1.0, 0]\njson = true\n"
      "[import.video]\nfov = 60\n";
  const Outcome configured = run(content, "");
  EXPECT_EQ(configured.exit_code, 0) << configured.err;
  EXPECT_THAT(configured.out, HasSubstr("\"threshold\": 0.07,"));
  const std::regex timings(R"("timings_ms": \{[^}]*\})");
  const Outcome typed = run("", "--threads 1 --threshold 0.07 --up 0,-1,0 --json");
  EXPECT_EQ(std::regex_replace(configured.out, timings, ""),
            std::regex_replace(typed.out, timings, ""));
  EXPECT_THAT(run(content, "--threshold=0.05").out, HasSubstr("\"threshold\": 0.05,"));
  EXPECT_THAT(run(content, "--threshold 0.04").out, HasSubstr("\"threshold\": 0.04,"));
  EXPECT_THAT(run("[plane]\njson = false\n", "--threshold 0.05").out, StartsWith("status"));
}

TEST_F(Configuration, MistakesAreNamedWithTheirLine) {
  const std::pair<const char*, const char*> cases[] = {
      {"[plane]\njsn = true\n", "line 2: camber plane has no option jsn: did you mean json?"},
      {"[plan]\n", "line 1: there is no command plan: did you mean [plane]?"},
      {"\n[plane\n", "line 2: found no TOML"},
      {"[plane]\n\nconfidence = \"high\"\n", "line 3: "},
      {"[plane]\nengine = \"other\"\n", "line 2: "},
      {"[plane]\nthreshold = true\n", "line 2: threshold: expected a value"},
      {"[plane]\njson = \"yes\"\n", "line 2: json: expected true or false"},
      {"[plane]\nup = []\n", "line 2: up: found an empty array"},
      {"[plane]\nup = [[0, 1, 0]]\n", "line 2: up: found a value of another kind"},
      {"[plane]\nthreshold = nan\n", "line 2: threshold: found a value of another kind"},
      {"[plane]\nconfig = \"more.toml\"\n", "line 2: config belongs on the command line"},
      {"threads = 1\nthreads = 2\n", "line 2: found no TOML"},
  };
  for (const auto& [content, message] : cases) {
    SCOPED_TRACE(content);
    const Outcome outcome = run(content, "");
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_EQ(outcome.out, "");
    EXPECT_THAT(outcome.err, StartsWith("camber: " + file_ + ": " + message));
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }
  const Outcome missing = run_camber("plane --config none.toml " + road_);
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_EQ(missing.err, "camber: none.toml: no such file\n");
}

TEST(EveryCommand, RefusesAnUnknownOptionAndABadValueWithExitCodeTwo) {
  for (const std::string& command : all_commands()) {
    for (const char* arguments : {" --no-such-option", " --threads some", " --seed x"}) {
      SCOPED_TRACE(command + arguments);
      const Outcome outcome = run_camber(command + arguments);
      EXPECT_EQ(outcome.exit_code, 2);
      EXPECT_EQ(outcome.out, "");
      EXPECT_THAT(outcome.err, StartsWith("camber: "));
      EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    }
  }
}

TEST(EveryCommand, RefusesAMissingInputWithExitCodeTwoAndItsName) {
  for (const std::string& command : all_commands()) {
    if (command == "synth") continue;  // makes its own input
    SCOPED_TRACE(command);
    const std::string& help = help_of(command).out;
    if (help.find("\nPositionals:") == std::string::npos) continue;
    // Whatever else is required is missing as well.
    std::string arguments = " no_such_input";
    static const std::regex required(R"(\n  (-[-a-z]+|[a-z]+) TEXT[^\n]*REQUIRED)");
    bool first = true;
    for (std::sregex_iterator at(help.begin(), help.end(), required), end; at != end; ++at) {
      const std::string name = (*at)[1];
      if (name == "--out") continue;
      if (name[0] == '-') {
        arguments += " " + name + " no_such_input";
      } else if (!first) {
        arguments += " no_such_input";
      } else {
        first = false;
      }
    }
    const Outcome outcome = run_camber(command + arguments + out_argument(help));
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_EQ(outcome.out, "");
    EXPECT_THAT(outcome.err, StartsWith("camber: "));
    EXPECT_THAT(outcome.err, HasSubstr("no_such_input"));
  }
}

TEST(Documentation, OfTheCommandsIsWhatTheProgramPrints) {
  if (std::system("python3 -c '' >/dev/null 2>&1") != 0) GTEST_SKIP() << "no python3";
  const fs::path docs = camber::test::source_dir() / "docs";
  const auto check = [&](const fs::path& page) {
    return std::system(("python3 -B '" + (docs / "make_pages.py").string() +
                        "' '" CAMBER_PROGRAM "' --check '" + page.string() + "'")
                           .c_str());
  };
  EXPECT_EQ(check(docs / "commands.md"), 0);
  const camber::test::TemporaryFolder folder;
  const fs::path other = folder.path() / "commands.md";
  std::ofstream(other) << read_text(docs / "commands.md") << "more\n";
  EXPECT_NE(check(other), 0);
}

TEST(Documentation, HasAManPageForEveryCommand) {
  if (std::system("python3 -c '' >/dev/null 2>&1") != 0) GTEST_SKIP() << "no python3";
  const camber::test::TemporaryFolder folder;
  const fs::path script = camber::test::source_dir() / "docs/make_pages.py";
  ASSERT_EQ(std::system(("python3 -B '" + script.string() + "' '" CAMBER_PROGRAM "' --man '" +
                         folder.path().string() + "'")
                            .c_str()),
            0);
  for (std::string name : all_commands()) {
    std::replace(name.begin(), name.end(), ' ', '-');
    const std::string page = read_text(folder.path() / ("camber-" + name + ".1"));
    EXPECT_THAT(page, StartsWith(".TH \"CAMBER-")) << name;
    EXPECT_THAT(page, HasSubstr("\n.SH EXAMPLES\n")) << name;
  }
}

TEST(Documentation, ShowsTheExamplesThatAreCompiledAndRun) {
  const fs::path root = camber::test::source_dir();
  const std::string page = read_text(root / "docs/library.md");
  const std::string sample = read_text(root / "samples/01_reconstruct.cpp");
  const auto code = sample.find("#include");
  ASSERT_NE(code, std::string::npos);
  EXPECT_THAT(page, HasSubstr("```cpp\n" + sample.substr(code) + "```\n"));
}

TEST(Documentation, LinksToFilesThatExist) {
  const fs::path root = camber::test::source_dir();
  std::vector<fs::path> pages = {root / "README.md", root / "CONTRIBUTING.md",
                                 root / "CHANGELOG.md", root / "SECURITY.md"};
  for (const auto& entry : fs::recursive_directory_iterator(root / "docs")) {
    if (entry.path().extension() == ".md") pages.push_back(entry.path());
  }
  static const std::regex link(R"(\]\(([^):#\s]+)(#[^)]*)?\))");
  for (const fs::path& page : pages) {
    const std::string text = read_text(page);
    EXPECT_NE(text, "") << page;
    for (std::sregex_iterator at(text.begin(), text.end(), link), end; at != end; ++at) {
      const fs::path target = page.parent_path() / (*at)[1].str();
      EXPECT_TRUE(fs::exists(target)) << page << ": " << (*at)[1];
    }
  }
}

TEST(Readme, IsOneScreen) {
  const std::string text = read_text(camber::test::source_dir() / "README.md");
  EXPECT_LE(std::count(text.begin(), text.end(), '\n'), 80);
  std::istringstream words(text);
  EXPECT_LE(std::distance(std::istream_iterator<std::string>(words), {}), 600);
}

}  // namespace

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace camber::tools {

/// A condition on the value of an option, as typed.
struct Check {
  std::function<std::string(const std::string&)> problem;  ///< what is wrong; empty: nothing
  std::string name;                                        ///< of the values, for --help
};

Check in_range(int low, int high);
Check in_range(double low, double high);
Check is_member(const std::vector<std::string>& values);
Check finite_number();
Check positive_number();
Check non_negative_number();
/// Digits alone: a whole number from 0 to 2^64 - 1.
Check whole_number();

/// What is in force of an option: what was given, else what was bound.
using OptionValue =
    std::variant<bool, std::int64_t, std::uint64_t, double, std::optional<int>, std::string,
                 std::vector<std::string>, std::vector<int>, std::vector<double>>;

/// What the parser knows of one option; each function returns the option itself.
class Option {
 public:
  Option* required();
  Option* delimiter(char separator);  ///< of a list within one word
  Option* expected(int count);        ///< values
  Option* type_name(const std::string& name);
  Option* capture_default_str();  ///< --help shows the value that is bound
  Option* needs(const std::string& name);
  Option* excludes(const std::string& name);
  Option* check(const Check& check);
  /// Its default hangs on other options or on the input: --print-config has it as a comment.
  Option* default_varies();

  // What a text names. Nothing where it has a check(); without any of these, what is read.
  Option* no_name();
  Option* output_file();
  Option* output_folder();    ///< that is replaced whole
  Option* output_manifest();  ///< a file in .json, else scene.json in that folder

 private:
  friend class App;
  std::function<OptionValue()> value_;
  enum class Names { kNothing, kInput, kOutputFile, kOutputFolder, kOutputManifest };
  void* option_ = nullptr;  // CLI::Option
  Names names_ = Names::kNothing;
  bool default_varies_ = false;
};

/// The files and folders that a command line names.
struct NamedFiles {
  std::vector<std::filesystem::path> inputs;   ///< some may name nothing
  std::vector<std::filesystem::path> outputs;  ///< files
  std::vector<std::filesystem::path> folders;  ///< of results, replaced whole
};

/// @param file  of an option; empty where it is not given. @throws UsageError for another ending.
void require_png(const char* option, const std::string& file);

/// The manifest that --out stands for: itself if it ends in .json, else scene.json in that folder.
std::filesystem::path manifest_of(const std::string& out);

/// A command line: options, positional arguments, and commands with their own. The parser is CLI11,
/// whose headers take seconds to compile: options.cpp alone includes them.
class App {
 public:
  App(const std::string& description, const std::string& name);
  ~App();
  App(const App&) = delete;
  App& operator=(const App&) = delete;

  /// Binds `value`, which must live as long as the app. T: std::string, int, std::uint64_t, double,
  /// std::optional<int>, or a std::vector of std::string, std::filesystem::path, int or double.
  template <typename T>
  Option* add_option(const std::string& name, T& value, const std::string& help);
  Option* add_flag(const std::string& name, bool& value, const std::string& help);
  App* add_subcommand(const std::string& name, const std::string& description);

  void footer(const std::string& text);
  void require_subcommand();
  void set_version(const std::string& text);  ///< --version prints it

  /// What is in force of all options with a name, by that without dashes.
  std::map<std::string, OptionValue> values() const;
  bool parsed() const;                               ///< whether the line names this command
  std::size_t count(const std::string& name) const;  ///< how often an option was given
  NamedFiles named_files() const;                    ///< of this command, as parsed

  /// Of a command with the options --config and --print-config: what the line leaves open is taken
  /// from the file, and what is in force is printed, with nothing else to be given.
  /// @return -1 to go on, else the exit code: 0 after --help, --version and --print-config, 2 after
  ///         a sentence on stderr about what is wrong, with the nearest name for one that does not
  ///         exist.
  /// @throws InputError of a configuration file.
  int parse(int argc, char** argv);

 private:
  struct Impl;
  explicit App(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// A number as text that reads back as the same number.
std::string to_text(double value);

}  // namespace camber::tools

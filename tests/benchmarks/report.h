#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

/// What the benchmark programs share: their common options, and one JSON object a run beside the
/// printed tables, from which BENCHMARK.md is made and two revisions are compared
/// (make_benchmark_md.py, compare_revisions.py).
namespace camber::bench {

/// One column of a table or of raw values. Rows are paired between revisions by their labels;
/// timings are left out of comparisons of accuracy.
struct Column {
  enum class Kind { kLabel, kValue, kTiming };
  enum class Better { kNeither, kLower, kHigher };
  std::string name;
  std::string unit;  ///< empty: none
  Kind kind = Kind::kValue;
  Better better = Better::kNeither;
};
Column label(std::string name);
Column value(std::string name, std::string unit = "");
Column lower(std::string name, std::string unit = "");
Column higher(std::string name, std::string unit = "");
Column timing(std::string name, std::string unit = "ms");

/// The rows of one printed table, at full precision.
class Table {
 public:
  Table(std::string title, std::string arguments, std::vector<Column> columns);
  /// @param cells  one a column: strings for labels, numbers otherwise; numbers that are not finite
  ///               become null. @throws std::logic_error for another count or kind, or a second row
  ///               with the same labels.
  void row(std::vector<nlohmann::json> cells);

 private:
  friend class Report;
  std::string title_, arguments_;
  std::vector<Column> columns_;
  std::vector<std::vector<nlohmann::json>> rows_;
};

/// Raw values, one row an item (a car, a scene, a cloud), so that revisions are compared item by
/// item.
class Items {
 public:
  explicit Items(std::vector<Column> columns);
  /// @param key  the same in every revision; what stands before its first '/' names the group
  /// within
  ///             which items are not independent (a scene). @throws std::logic_error for a second
  ///             item of that name, or another number of values than columns.
  void add(const std::string& key, std::vector<double> values);

 private:
  friend class Report;
  std::vector<Column> columns_;
  std::map<std::string, std::vector<double>> values_;
};

/// What a program is called with besides the common options.
struct Program {
  struct Option {
    std::string name;      ///< "--keep"
    std::string argument;  ///< "DIR"; empty: a flag
    std::string help;
    bool changes_results = true;  ///< false: left out of the commands that the tables name
  };
  std::string name, description;
  std::vector<std::string> sections;  ///< words that pick parts; none given: all
  std::vector<Option> options;
};

/// What the command line asked for.
struct Settings {
  std::filesystem::path json;  ///< empty: none
  std::uint64_t first_seed = 0, last_seed = 0;
  bool range = false;          ///< several seeds: each gets a file of its own
  bool resume = false;         ///< seeds whose file is there are left out
  bool accuracy_only = false;  ///< every job once, no other libraries, no timings in the JSON
  std::vector<std::string> sections;
  std::map<std::string, std::string> options;  ///< as given; flags: "1"
};

/// @throws UsageError.
Settings parse_settings(const Program& program, const std::vector<std::string>& words);

/// The file of one seed: `json`, with "-SEED" before its extension where there are several.
std::filesystem::path json_path(const Settings& settings, std::uint64_t seed);

/// One run with one seed.
class Report {
 public:
  Report(Program program, Settings settings, std::uint64_t seed);
  std::uint64_t seed() const { return seed_; }
  bool accuracy_only() const { return settings_.accuracy_only; }
  bool wanted(const std::string& section) const;
  bool flag(const std::string& option) const { return settings_.options.count(option) > 0; }
  /// Empty where the option was not given.
  std::string option(const std::string& name) const;
  /// @throws UsageError if it is no whole number above 0.
  std::size_t count(const std::string& option, std::size_t otherwise) const;

  /// @param key        the same in every revision, unique.
  /// @param arguments  what makes the program print this table alone.
  Table& table(const std::string& key, std::string title, std::string arguments,
               std::vector<Column> columns);
  Items& items(const std::string& key, std::vector<Column> columns);

  nlohmann::json json() const;

 private:
  Program program_;
  Settings settings_;
  std::uint64_t seed_;
  std::string date_;
  std::vector<double> load_before_;
  std::vector<std::pair<std::string, std::unique_ptr<Table>>> tables_;
  std::map<std::string, std::unique_ptr<Items>> items_;
};

/// Parses, runs the body once a seed and writes its JSON (atomically) after each; main() of every
/// program. @return exit code: 0; 2 bad usage or input; 1 no answer; 3 the machine refuses.
int run_program(const Program& program, int argc, char** argv,
                const std::function<void(Report&)>& body);

/// What these programs were built from, by git: the commit, with "-dirty" where files differ from
/// it; and the tree object of lib/, by which commits that leave the library alone are seen to have
/// the same one. "unknown" without git.
const char* revision();
const char* library_tree();

}  // namespace camber::bench

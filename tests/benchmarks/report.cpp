#include "benchmarks/report.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <stdexcept>
#include <thread>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"

namespace camber::bench {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::uint64_t kMostSeeds = 1000;

json to_json(const Column& column) {
  json out = {{"name", column.name}};
  if (!column.unit.empty()) out["unit"] = column.unit;
  if (column.kind == Column::Kind::kLabel) out["label"] = true;
  if (column.kind == Column::Kind::kTiming) out["timing"] = true;
  if (column.better != Column::Better::kNeither) {
    out["better"] = column.better == Column::Better::kLower ? "lower" : "higher";
  }
  return out;
}

json to_json(const std::vector<Column>& columns) {
  json out = json::array();
  for (const Column& column : columns) out.push_back(to_json(column));
  return out;
}

json finite_or_null(double value) { return std::isfinite(value) ? json(value) : json(); }

std::string processor_name() {
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);) {
    const std::size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos) {
      return line.substr(colon + 2);
    }
  }
  return "unknown";
}

/// Mean number of processes that wanted to run in the last minute; empty where it is not known.
std::vector<double> load_average() {
  double load = 0.0;
  if (::getloadavg(&load, 1) != 1) return {};
  return {load};
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

/// "A:B", both ends.
void parse_range(const std::string& text, Settings& settings) {
  unsigned long long first = 0, last = 0;
  int end = 0;
  if (text.find_first_not_of("0123456789:") != std::string::npos ||
      std::sscanf(text.c_str(), "%llu:%llu%n", &first, &last, &end) != 2 ||
      static_cast<std::size_t>(end) != text.size() || last < first || last - first >= kMostSeeds) {
    throw UsageError("--seeds: found '" + text + "', expected FIRST:LAST, at most 1000 seeds");
  }
  settings.first_seed = first;
  settings.last_seed = last;
  settings.range = true;
}

}  // namespace

Column label(std::string name) {
  return {std::move(name), "", Column::Kind::kLabel, Column::Better::kNeither};
}
Column value(std::string name, std::string unit) {
  return {std::move(name), std::move(unit), Column::Kind::kValue, Column::Better::kNeither};
}
Column lower(std::string name, std::string unit) {
  return {std::move(name), std::move(unit), Column::Kind::kValue, Column::Better::kLower};
}
Column higher(std::string name, std::string unit) {
  return {std::move(name), std::move(unit), Column::Kind::kValue, Column::Better::kHigher};
}
Column timing(std::string name, std::string unit) {
  return {std::move(name), std::move(unit), Column::Kind::kTiming, Column::Better::kLower};
}

Table::Table(std::string title, std::string arguments, std::vector<Column> columns)
    : title_(std::move(title)), arguments_(std::move(arguments)), columns_(std::move(columns)) {}

void Table::row(std::vector<json> cells) {
  if (cells.size() != columns_.size()) throw std::logic_error(title_ + ": cells without a column");
  std::vector<json> labels;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const bool is_label = columns_[i].kind == Column::Kind::kLabel;
    if (is_label != cells[i].is_string()) {
      throw std::logic_error(title_ + ", " + columns_[i].name + ": labels are strings");
    }
    if (is_label) {
      labels.push_back(cells[i]);
    } else {
      cells[i] = finite_or_null(cells[i].get<double>());
    }
  }
  for (const std::vector<json>& other : rows_) {
    std::vector<json> taken;
    for (const json& cell : other) {
      if (cell.is_string()) taken.push_back(cell);
    }
    if (taken == labels) throw std::logic_error(title_ + ": a second row " + json(labels).dump());
  }
  rows_.push_back(std::move(cells));
}

Items::Items(std::vector<Column> columns) : columns_(std::move(columns)) {}

void Items::add(const std::string& key, std::vector<double> values) {
  if (values.size() != columns_.size()) throw std::logic_error(key + ": values without a column");
  if (!values_.emplace(key, std::move(values)).second) throw std::logic_error(key + ": twice");
}

Settings parse_settings(const Program& program, const std::vector<std::string>& words) {
  CLI::App app(program.description, program.name);
  Settings settings;
  std::string json, seed = "0", range;
  app.add_option("--json", json,
                 "Write the tables and raw values here; with several seeds one file each, the seed "
                 "before the extension")
      ->type_name("FILE");
  CLI::Option* one =
      app.add_option("--seed", seed, "Of everything random")->type_name("N")->capture_default_str();
  app.add_option("--seeds", range, "One run a seed from A to B")->type_name("A:B")->excludes(one);
  app.add_flag("--resume", settings.resume, "Leave out seeds whose file is there");
  app.add_flag("--accuracy-only", settings.accuracy_only,
               "Every job once, no other libraries, no times in FILE");
  if (!program.sections.empty()) {
    app.add_option("sections", settings.sections, "Parts to run (default: all)")
        ->type_name("")
        ->check(CLI::IsMember(program.sections));
  }
  std::map<std::string, std::string> values;
  std::map<std::string, bool> flags;
  for (const Program::Option& option : program.options) {
    if (option.argument.empty()) {
      app.add_flag(option.name, flags[option.name], option.help);
    } else {
      app.add_option(option.name, values[option.name], option.help)->type_name(option.argument);
    }
  }
  try {
    app.parse(
        std::vector<std::string>(words.rbegin(), words.rend()));  // it takes them from the end
  } catch (const CLI::CallForHelp&) {
    std::fputs(app.help().c_str(), stdout);
    std::exit(0);
  } catch (const CLI::ParseError& error) {
    throw UsageError(error.what());
  }
  settings.json = json;
  if (seed.empty() || seed.size() > 18 ||
      seed.find_first_not_of("0123456789") != std::string::npos) {
    throw UsageError("--seed: found '" + seed + "', expected a whole number");
  }
  settings.first_seed = settings.last_seed = std::stoull(seed);
  if (!range.empty()) parse_range(range, settings);
  for (const auto& [name, text] : values) {
    if (app.get_option(name)->count() > 0) settings.options[name] = text;
  }
  for (const auto& [name, given] : flags) {
    if (given) settings.options[name] = "1";
  }
  return settings;
}

fs::path json_path(const Settings& settings, std::uint64_t seed) {
  if (!settings.range) return settings.json;
  fs::path name = settings.json.stem();
  name += "-" + std::to_string(seed) + settings.json.extension().string();
  return settings.json.parent_path() / name;
}

Report::Report(Program program, Settings settings, std::uint64_t seed)
    : program_(std::move(program)),
      settings_(std::move(settings)),
      seed_(seed),
      date_(utc_now()),
      load_before_(load_average()) {}

bool Report::wanted(const std::string& section) const {
  const std::vector<std::string>& given = settings_.sections;
  return given.empty() || std::find(given.begin(), given.end(), section) != given.end();
}

std::string Report::option(const std::string& name) const {
  const auto found = settings_.options.find(name);
  return found == settings_.options.end() ? "" : found->second;
}

std::size_t Report::count(const std::string& name, std::size_t otherwise) const {
  const std::string text = option(name);
  if (text.empty()) return otherwise;
  if (text.find_first_not_of("0123456789") != std::string::npos || text.size() > 12 ||
      std::stoull(text) == 0) {
    throw UsageError(name + ": found '" + text + "', expected a whole number above 0");
  }
  return std::stoull(text);
}

Table& Report::table(const std::string& key, std::string title, std::string arguments,
                     std::vector<Column> columns) {
  for (const auto& [other, table] : tables_) {
    if (other == key) throw std::logic_error(key + ": a table of that key is there");
  }
  tables_.emplace_back(
      key, std::make_unique<Table>(std::move(title), std::move(arguments), std::move(columns)));
  return *tables_.back().second;
}

Items& Report::items(const std::string& key, std::vector<Column> columns) {
  const auto [place, is_new] = items_.emplace(key, std::make_unique<Items>(std::move(columns)));
  if (!is_new) throw std::logic_error(key + ": items of that key are there");
  return *place->second;
}

json Report::json() const {
  nlohmann::json out;
  out["format"] = "camber-benchmark";
  out["version"] = 1;
  out["program"] = program_.name;
  out["revision"] = revision();
  out["library_tree"] = library_tree();
  out["date"] = date_;
  out["machine"] = {{"cpu", processor_name()},
                    {"cores", std::thread::hardware_concurrency()},
                    {"load_average", {{"before", load_before_}, {"after", load_average()}}}};
  out["seed"] = seed_;
  nlohmann::json options = {{"accuracy_only", settings_.accuracy_only},
                            {"sections", settings_.sections}};
  std::string changed;  // the part of the command line that changes what a table says
  for (const Program::Option& option : program_.options) {
    if (!option.changes_results || !flag(option.name)) continue;
    const std::string given = Report::option(option.name);
    options[option.name.substr(2)] = given;
    changed += " " + option.name + (option.argument.empty() ? "" : " " + given);
  }
  if (seed_ != 0) changed += " --seed " + std::to_string(seed_);
  out["options"] = options;
  out["tables"] = nlohmann::json::array();
  for (const auto& [key, table] : tables_) {
    nlohmann::json rows = nlohmann::json::array();
    for (const std::vector<nlohmann::json>& cells : table->rows_) {
      nlohmann::json row = nlohmann::json::array();
      for (std::size_t i = 0; i < cells.size(); ++i) {
        const bool hidden =
            settings_.accuracy_only && table->columns_[i].kind == Column::Kind::kTiming;
        row.push_back(hidden ? nlohmann::json() : cells[i]);
      }
      rows.push_back(row);
    }
    const std::string arguments = table->arguments_.empty() ? "" : " " + table->arguments_;
    out["tables"].push_back(
        {{"key", key},
         {"name", table->title_},
         {"command", "build/release/bin/" + program_.name + arguments + changed},
         {"columns", to_json(table->columns_)},
         {"rows", rows}});
  }
  out["items"] = nlohmann::json::object();
  for (const auto& [key, items] : items_) {
    nlohmann::json values = nlohmann::json::object();
    for (const auto& [item, numbers] : items->values_) {
      nlohmann::json row = nlohmann::json::array();
      for (std::size_t i = 0; i < numbers.size(); ++i) {
        const bool hidden =
            settings_.accuracy_only && items->columns_[i].kind == Column::Kind::kTiming;
        row.push_back(hidden ? nlohmann::json() : finite_or_null(numbers[i]));
      }
      values[item] = row;
    }
    out["items"][key] = {{"columns", to_json(items->columns_)}, {"values", values}};
  }
  return out;
}

int run_program(const Program& program, int argc, char** argv,
                const std::function<void(Report&)>& body) {
  try {
    const Settings settings = parse_settings(program, {argv + 1, argv + argc});
    for (std::uint64_t seed = settings.first_seed; seed <= settings.last_seed; ++seed) {
      const fs::path file = json_path(settings, seed);
      if (settings.resume && !file.empty() && fs::exists(file)) continue;
      if (settings.range) std::printf("\n# Seed %llu\n", static_cast<unsigned long long>(seed));
      Report report(program, settings, seed);
      body(report);
      std::fflush(stdout);
      if (!file.empty()) write_file_atomically(file, report.json().dump(1) + "\n");
    }
    return 0;
  } catch (const Error& error) {
    std::fprintf(stderr, "%s: %s\n", program.name.c_str(), error.what());
    return error.exit_code();
  }
}

}  // namespace camber::bench

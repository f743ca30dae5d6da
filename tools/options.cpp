#include "options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <optional>
#include <set>

#include "camber/core/errors.h"
#include "config_file.h"
#include "nearest_name.h"
#include "standard_streams.h"

namespace camber::tools {
namespace {

CLI::Option* raw(void* option) { return static_cast<CLI::Option*>(option); }

Check number_check(bool (*holds)(double), const char* expected, const char* name) {
  return {[holds, expected](const std::string& text) {
            double value = 0.0;
            const bool good =
                CLI::detail::lexical_cast(text, value) && std::isfinite(value) && holds(value);
            return good ? std::string() : "found '" + text + "', expected " + expected;
          },
          name};
}

/// A validator of CLI11's as a check of ours, with the name that it has in --help.
Check adopt(const CLI::Validator& validator) {
  return {[validator](const std::string& text) { return validator(text); },
          validator.get_description()};
}

/// The names that may stand at a place of the command line, as typed.
std::vector<std::string> option_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

std::vector<std::string> command_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* below : app.get_subcommands({})) names.push_back(below->get_name());
  return names;
}

/// The same in a sentence, with the command that has no place for them.
std::string unexpected(const CLI::App& root) {
  const CLI::App* app = &root;
  std::string command = "camber";
  while (!app->get_subcommands().empty()) {
    app = app->get_subcommands().front();
    command += " " + app->get_name();
  }
  std::string text = command + " has no place for";
  for (const std::string& word : app->remaining()) text += " " + word;
  return text;
}

/// What was probably meant by the first word that has no place on the line; empty: no idea.
std::string advice(const CLI::App& root) {
  const CLI::App* app = &root;
  while (!app->get_subcommands().empty()) app = app->get_subcommands().front();
  for (const std::string& word : app->remaining()) {
    const bool option = word.size() > 1 && word.front() == '-';
    const std::string typed = word.substr(0, word.find('='));
    const std::string meant =
        nearest_name(typed, option ? option_names(*app) : command_names(*app));
    if (!meant.empty()) return "; found " + typed + ": did you mean " + meant + "?";
  }
  const std::vector<std::string> commands = command_names(*app);
  if (commands.empty()) return "";
  std::string text = "; expected ";
  for (std::size_t i = 0; i < commands.size(); ++i) {
    text += (i == 0 ? "" : i + 1 == commands.size() ? " or " : ", ") + commands[i];
  }
  return text;
}

// ---- --config and --print-config ----------------------------------------------------------------

bool is_flag(const CLI::Option& option) { return option.get_expected_min() == 0; }

/// A command line on its way to the parser.
struct Line {
  std::vector<std::string> words;  // without the program's name
  CLI::App* command = nullptr;     // that the first ones name
  std::vector<std::string> names;  // of the commands down to it

  Line(CLI::App& root, int argc, char** argv) : words(argv + 1, argv + argc), command(&root) {
    for (const std::string& word : words) {
      const std::vector<std::string> below = command_names(*command);
      if (std::find(below.begin(), below.end(), word) == below.end()) break;
      command = command->get_subcommand(word);
      names.push_back(word);
    }
  }

  /// Where the words end that may be options.
  std::size_t end() const {
    return static_cast<std::size_t>(std::find(words.begin(), words.end(), "--") - words.begin());
  }

  CLI::Option* option_of(const std::string& word) const {
    if (word.size() < 2 || word[0] != '-') return nullptr;
    return command->get_option_no_throw(word.substr(0, word.find('=')));
  }

  bool has(const std::string& name) const {
    const auto stop = words.begin() + static_cast<std::ptrdiff_t>(end());
    return std::find(words.begin(), stop, name) != stop;
  }

  /// The value of an option of one value, where it is given and has one.
  std::optional<std::string> value_of(const std::string& name) const {
    for (std::size_t i = names.size(); i < end(); ++i) {
      if (words[i] == name && i + 1 < end()) return words[i + 1];
      if (words[i].rfind(name + "=", 0) == 0) return words[i].substr(name.size() + 1);
    }
    return std::nullopt;
  }
};

/// An item of a configuration file as it would be typed.
std::vector<std::string> words_of(const ConfigItem& item, const CLI::Option& option,
                                  const std::string& file) {
  const std::string place = "line " + std::to_string(item.line);
  const std::string name = "--" + item.key;
  if (is_flag(option)) {
    if (!item.truth) throw InputError(file, place, item.key + ": expected true or false");
    return *item.truth ? std::vector<std::string>{name} : std::vector<std::string>{};
  }
  if (item.truth) throw InputError(file, place, item.key + ": expected a value, not true or false");
  if (const char separator = option.get_delimiter()) {
    std::string joined;
    for (const std::string& value : item.values) {
      joined += (joined.empty() ? std::string() : std::string(1, separator)) + value;
    }
    return {name + "=" + joined};
  }
  if (item.values.size() == 1) return {name + "=" + item.values[0]};
  const auto most = static_cast<std::size_t>(option.get_items_expected_max());
  if (item.values.size() > most) {
    throw InputError(file, place,
                     item.key + ": found an array of " + std::to_string(item.values.size()) +
                         " values, expected " +
                         (most == 1 ? "one value" : "at most " + std::to_string(most)));
  }
  std::vector<std::string> words = {name};
  words.insert(words.end(), item.values.begin(), item.values.end());
  return words;
}

/// Adds to the line what the file has for its command and the line has not.
std::vector<ConfigItem> add_config(const std::string& file, Line* line) {
  std::set<const CLI::Option*> given;
  for (std::size_t i = 0; i < line->end(); ++i) given.insert(line->option_of(line->words[i]));
  std::vector<ConfigItem> items = read_config(file, line->names);
  std::vector<std::string> added;
  for (const ConfigItem& item : items) {
    const CLI::Option* option = line->command->get_option_no_throw("--" + item.key);
    std::string problem;
    if (item.key == "config" || item.key == "print-config" || item.key == "help") {
      problem = item.key + " belongs on the command line";
    } else if (!option) {
      const std::string meant = nearest_name("--" + item.key, option_names(*line->command));
      problem = "camber";
      for (const std::string& name : line->names) problem += " " + name;
      problem += " has no option " + item.key;
      if (!meant.empty()) problem += ": did you mean " + meant.substr(2) + "?";
    }
    if (!problem.empty()) throw InputError(file, "line " + std::to_string(item.line), problem);
    if (given.count(option)) continue;
    for (std::string& word : words_of(item, *option, file)) added.push_back(std::move(word));
  }
  line->words.insert(line->words.begin() + static_cast<std::ptrdiff_t>(line->end()), added.begin(),
                     added.end());
  return items;
}

/// Which item of a file the parser's message is about, with its line; empty: none.
std::string place_in_config(const std::string& message, const std::vector<ConfigItem>& items) {
  for (const ConfigItem& item : items) {
    const std::size_t at = message.find("--" + item.key);
    if (at == std::string::npos) continue;
    const std::size_t next = at + 2 + item.key.size();
    if (next < message.size() && (std::isalnum(message[next]) || message[next] == '-')) continue;
    return "line " + std::to_string(item.line) + ": ";
  }
  return "";
}

/// The digits of default values that --help rounds.
using DefaultNumbers = std::map<const CLI::Option*, std::vector<std::string>>;

/// The values that an option has without being given, as they would be typed.
std::vector<std::string> default_values(const CLI::Option& option, const DefaultNumbers& numbers) {
  std::string text = option.get_default_str();
  const auto exact = numbers.find(&option);
  if (!text.empty() && exact != numbers.end()) return exact->second;
  if (text.size() < 2 || text.front() != '[' || text.back() != ']') {
    return text.empty() ? std::vector<std::string>{} : std::vector<std::string>{text};
  }
  text = text.substr(1, text.size() - 2);
  return text.empty() ? std::vector<std::string>{} : CLI::detail::split(text, ',');
}

/// Whether another option that is given excludes it.
bool is_excluded(const CLI::Option& option) {
  const auto& excluding = option.get_excludes();
  return std::any_of(excluding.begin(), excluding.end(),
                     [](const CLI::Option* other) { return other->count() > 0; });
}

/// Whether an option that it needs is not given.
bool lacks_needed(const CLI::Option& option) {
  const auto& needed = option.get_needs();
  return std::any_of(needed.begin(), needed.end(),
                     [](const CLI::Option* other) { return other->count() == 0; });
}

/// All options of a command as a table of a configuration file.
/// @param varying  whose defaults are no choice that the file could make
void print_config(const Line& line, const DefaultNumbers& numbers,
                  const std::set<const CLI::Option*>& varying) {
  std::string table;
  for (const std::string& name : line.names) table += (table.empty() ? "" : ".") + name;
  std::cout << "[" << table << "]\n";
  for (const CLI::Option* option : line.command->get_options()) {
    if (option->get_lnames().empty()) continue;
    const std::string& name = option->get_lnames().front();
    if (name == "help" || name == "config" || name == "print-config") continue;
    const bool open = option->count() == 0 &&
                      (varying.count(option) > 0 || is_excluded(*option) || lacks_needed(*option));
    if (open) std::cout << "# ";
    if (is_flag(*option)) {
      std::cout << name << " = " << (option->count() > 0 ? "true" : "false") << "\n";
      continue;
    }
    const std::vector<std::string> values =
        option->count() > 0 ? option->results() : default_values(*option, numbers);
    const bool list = option->get_items_expected_max() > 1 || values.size() > 1;
    if (values.empty()) {
      std::cout << (open ? "" : "# ") << name << " =\n";
    } else {
      std::cout << name << " = " << to_toml(values, list) << "\n";
    }
  }
}

}  // namespace

Check in_range(int low, int high) { return adopt(CLI::Range(low, high)); }
Check in_range(double low, double high) {
  // CLI11's range lets through what is neither below nor above it: NaN.
  Check range = adopt(CLI::Range(low, high));
  range.problem = [inside = range.problem,
                   number = finite_number().problem](const std::string& text) {
    const std::string wrong = number(text);
    return wrong.empty() ? inside(text) : wrong;
  };
  return range;
}
Check is_member(const std::vector<std::string>& values) { return adopt(CLI::IsMember(values)); }
Check finite_number() {
  return number_check([](double) { return true; }, "a number", "");
}
Check positive_number() {
  return number_check([](double value) { return value > 0.0; }, "a number above 0", "POSITIVE");
}
Check non_negative_number() {
  return number_check([](double value) { return value >= 0.0; }, "a number of at least 0",
                      "NONNEGATIVE");
}

// The parser takes -1 for 2^64 - 1.
Check whole_number() {
  return {[](const std::string& text) {
            std::uint64_t value = 0;
            const char* end = text.data() + text.size();
            const auto [at, error] = std::from_chars(text.data(), end, value);
            return error == std::errc() && at == end
                       ? std::string()
                       : "found '" + text +
                             "', expected a whole number from 0 to 18446744073709551615";
          },
          ""};
}

Option* Option::required() { return raw(option_)->required(), this; }
Option* Option::delimiter(char separator) { return raw(option_)->delimiter(separator), this; }
Option* Option::expected(int count) { return raw(option_)->expected(count), this; }
Option* Option::type_name(const std::string& name) { return raw(option_)->type_name(name), this; }
Option* Option::capture_default_str() { return raw(option_)->capture_default_str(), this; }
Option* Option::needs(const std::string& name) { return raw(option_)->needs(name), this; }
Option* Option::excludes(const std::string& name) { return raw(option_)->excludes(name), this; }
Option* Option::default_varies() { return default_varies_ = true, this; }
Option* Option::no_name() { return names_ = Names::kNothing, this; }
Option* Option::output_file() { return names_ = Names::kOutputFile, this; }
Option* Option::output_folder() { return names_ = Names::kOutputFolder, this; }
Option* Option::output_manifest() { return names_ = Names::kOutputManifest, this; }
Option* Option::check(const Check& check) {
  names_ = Names::kNothing;
  const auto test = check.problem;
  raw(option_)->check(CLI::Validator([test](std::string& text) { return test(text); }, check.name));
  return this;
}

struct App::Impl {
  std::unique_ptr<CLI::App> owned;  // of the root
  CLI::App* app = nullptr;
  std::deque<Option> options;
  std::deque<std::unique_ptr<App>> below;
  DefaultNumbers numbers;

  DefaultNumbers numbers_of_all() const {
    DefaultNumbers all = numbers;
    for (const std::unique_ptr<App>& command : below) all.merge(command->impl_->numbers_of_all());
    return all;
  }
  std::set<const CLI::Option*> varying_of_all() const {
    std::set<const CLI::Option*> all;
    for (const Option& option : options) {
      if (option.default_varies_) all.insert(static_cast<const CLI::Option*>(option.option_));
    }
    for (const std::unique_ptr<App>& command : below) all.merge(command->impl_->varying_of_all());
    return all;
  }
};

App::App(const std::string& description, const std::string& name)
    : impl_(std::make_unique<Impl>()) {
  impl_->owned = std::make_unique<CLI::App>(description, name);
  impl_->app = impl_->owned.get();
  impl_->app->failure_message([](const CLI::App*, const CLI::Error& error) {
    return "camber: " + one_line(error.what()) + "\n";
  });
}
App::App(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
App::~App() = default;

namespace {

template <typename T>
OptionValue value_of(const T& value) {
  if constexpr (std::is_same_v<T, int>) {
    return std::int64_t{value};
  } else if constexpr (std::is_same_v<T, std::vector<std::filesystem::path>>) {
    return std::vector<std::string>(value.begin(), value.end());
  } else {
    return value;
  }
}

}  // namespace

template <typename T>
Option* App::add_option(const std::string& name, T& value, const std::string& help) {
  Option& option = impl_->options.emplace_back();
  option.value_ = [&value] { return value_of(value); };
  CLI::Option* added = impl_->app->add_option(name, value, help);
  option.option_ = added;
  constexpr bool text = std::is_same_v<T, std::string> ||
                        std::is_same_v<T, std::vector<std::string>> ||
                        std::is_same_v<T, std::vector<std::filesystem::path>>;
  if constexpr (text) option.names_ = Option::Names::kInput;
  if constexpr (std::is_same_v<T, double>) impl_->numbers[added] = {to_text(value)};
  if constexpr (std::is_same_v<T, std::vector<double>>) {
    for (const double number : value) impl_->numbers[added].push_back(to_text(number));
  }
  return &option;
}

#define CAMBER_OPTION_OF(...)                                                     \
  template Option* App::add_option<__VA_ARGS__>(const std::string&, __VA_ARGS__&, \
                                                const std::string&)
CAMBER_OPTION_OF(std::string);
CAMBER_OPTION_OF(int);
CAMBER_OPTION_OF(std::uint64_t);
CAMBER_OPTION_OF(double);
CAMBER_OPTION_OF(std::optional<int>);
CAMBER_OPTION_OF(std::vector<std::string>);
CAMBER_OPTION_OF(std::vector<std::filesystem::path>);
CAMBER_OPTION_OF(std::vector<int>);
CAMBER_OPTION_OF(std::vector<double>);
#undef CAMBER_OPTION_OF

Option* App::add_flag(const std::string& name, bool& value, const std::string& help) {
  Option& option = impl_->options.emplace_back();
  option.option_ = impl_->app->add_flag(name, value, help);
  option.value_ = [&value] { return OptionValue(value); };
  return &option;
}

App* App::add_subcommand(const std::string& name, const std::string& description) {
  auto impl = std::make_unique<Impl>();
  impl->app = impl_->app->add_subcommand(name, description);
  return impl_->below.emplace_back(new App(std::move(impl))).get();
}

std::map<std::string, OptionValue> App::values() const {
  std::map<std::string, OptionValue> values;
  for (const Option& option : impl_->options) {
    const std::vector<std::string>& names = raw(option.option_)->get_lnames();
    if (!names.empty()) values.emplace(names.front(), option.value_());
  }
  return values;
}

void App::footer(const std::string& text) { impl_->app->footer(text); }
void App::require_subcommand() { impl_->app->require_subcommand(1); }
void App::set_version(const std::string& text) { impl_->app->set_version_flag("--version", text); }
bool App::parsed() const { return impl_->app->parsed(); }
std::size_t App::count(const std::string& name) const { return impl_->app->count(name); }

NamedFiles App::named_files() const {
  using Names = Option::Names;
  NamedFiles named;
  for (const Option& option : impl_->options) {
    if (option.names_ == Names::kNothing) continue;
    for (const std::string& value : raw(option.option_)->results()) {
      if (value.empty()) continue;
      if (option.names_ == Names::kInput) named.inputs.emplace_back(value);
      if (option.names_ == Names::kOutputFile) named.outputs.emplace_back(value);
      if (option.names_ == Names::kOutputManifest) named.outputs.push_back(manifest_of(value));
      if (option.names_ == Names::kOutputFolder) named.folders.emplace_back(value);
    }
  }
  return named;
}

int App::parse(int argc, char** argv) {
  CLI::App& app = *impl_->app;
  Line line(app, argc, argv);
  const bool configurable = line.command->get_option_no_throw("--config") != nullptr;
  const bool printing = configurable && line.has("--print-config");
  const auto file = configurable ? line.value_of("--config") : std::nullopt;
  std::vector<ConfigItem> items;
  if (file && !line.has("--help") && !line.has("-h")) items = add_config(*file, &line);
  if (printing) {
    for (CLI::Option* option : line.command->get_options()) option->required(false);
  }
  try {
    std::vector<std::string> words(line.words.rbegin(), line.words.rend());
    app.parse(std::move(words));
    if (!printing) return -1;
    print_config(line, impl_->numbers_of_all(), impl_->varying_of_all());
    return 0;
  } catch (const CLI::RequiredError& error) {
    std::cerr << "camber: " << one_line(error.what() + advice(app)) << "\n";
  } catch (const CLI::ExtrasError&) {
    std::cerr << "camber: " << one_line(unexpected(app) + advice(app)) << "\n";
  } catch (const CLI::ParseError& error) {
    const std::string place = place_in_config(error.what(), items);
    if (place.empty()) return app.exit(error) == 0 ? 0 : 2;
    std::cerr << "camber: " << one_line(*file + ": " + place + error.what()) << "\n";
  }
  return 2;
}

void require_png(const char* option, const std::string& file) {
  if (file.empty() || std::filesystem::path(file).extension() == ".png") return;
  throw UsageError(std::string(option) + ": found '" + file + "', expected FILE.png");
}

std::filesystem::path manifest_of(const std::string& out) {
  const std::filesystem::path path = out;
  return path.extension() == ".json" ? path : path / "scene.json";
}

std::string to_text(double value) {
  char text[32];
  const auto [end, error] = std::to_chars(text, text + sizeof(text), value);
  return error == std::errc() ? std::string(text, end) : std::string();
}

}  // namespace camber::tools

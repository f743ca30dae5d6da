#include "options.h"

#include <CLI/CLI.hpp>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <optional>

#include "nearest_name.h"

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

/// What was probably meant by the first word that has no place on the line; empty: no idea.
std::string advice(const CLI::App& root) {
  const CLI::App* app = &root;
  while (!app->get_subcommands().empty()) app = app->get_subcommands().front();
  const std::vector<std::string> words = app->remaining();
  // The parser lists them from the last to the first.
  for (auto word = words.rbegin(); word != words.rend(); ++word) {
    const bool option = word->size() > 1 && word->front() == '-';
    const std::string typed = word->substr(0, word->find('='));
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

}  // namespace

Check in_range(int low, int high) { return adopt(CLI::Range(low, high)); }
Check in_range(double low, double high) { return adopt(CLI::Range(low, high)); }
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
Option* Option::check(const Check& check) {
  const auto test = check.problem;
  raw(option_)->check(CLI::Validator([test](std::string& text) { return test(text); }, check.name));
  return this;
}

struct App::Impl {
  std::unique_ptr<CLI::App> owned;  // of the root
  CLI::App* app = nullptr;
  std::deque<Option> options;
  std::deque<std::unique_ptr<App>> below;
};

App::App(const std::string& description, const std::string& name)
    : impl_(std::make_unique<Impl>()) {
  impl_->owned = std::make_unique<CLI::App>(description, name);
  impl_->app = impl_->owned.get();
  impl_->app->failure_message([](const CLI::App*, const CLI::Error& error) {
    return "camber: " + std::string(error.what()) + "\n";
  });
}
App::App(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
App::~App() = default;

template <typename T>
Option* App::add_option(const std::string& name, T& value, const std::string& help) {
  Option& option = impl_->options.emplace_back();
  option.option_ = impl_->app->add_option(name, value, help);
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
  return &option;
}

App* App::add_subcommand(const std::string& name, const std::string& description) {
  auto impl = std::make_unique<Impl>();
  impl->app = impl_->app->add_subcommand(name, description);
  return impl_->below.emplace_back(new App(std::move(impl))).get();
}

void App::footer(const std::string& text) { impl_->app->footer(text); }
void App::require_subcommand() { impl_->app->require_subcommand(1); }
void App::set_version(const std::string& text) { impl_->app->set_version_flag("--version", text); }
bool App::parsed() const { return impl_->app->parsed(); }
std::size_t App::count(const std::string& name) const { return impl_->app->count(name); }

int App::parse(int argc, char** argv) {
  CLI::App& app = *impl_->app;
  try {
    app.parse(argc, argv);
    return -1;
  } catch (const CLI::RequiredError& error) {
    std::cerr << "camber: " << error.what() << advice(app) << "\n";
  } catch (const CLI::ExtrasError& error) {
    std::cerr << "camber: " << error.what() << advice(app) << "\n";
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return 2;
}

std::string to_text(double value) { return CLI::detail::to_string(value); }

}  // namespace camber::tools

#include "camber/core/status.h"

#include <array>
#include <stdexcept>
#include <utility>

namespace camber {
namespace {
constexpr std::array<std::pair<Status, std::string_view>, 5> kWords = {{
    {Status::kNotRun, "not_run"},
    {Status::kOk, "ok"},
    {Status::kWeak, "weak"},
    {Status::kNotObservable, "not_observable"},
    {Status::kFailed, "failed"},
}};
}  // namespace

std::string_view to_string(Status status) {
  for (const auto& [value, word] : kWords) {
    if (value == status) return word;
  }
  return "failed";
}

Status status_from_string(std::string_view word) {
  for (const auto& [value, name] : kWords) {
    if (name == word) return value;
  }
  throw std::invalid_argument("unknown status '" + std::string(word) +
                              "', expected ok, weak, not_observable, failed or not_run");
}

}  // namespace camber

#pragma once

#include <string>
#include <string_view>

namespace camber {

/// How far an estimate can be trusted.
enum class Status {
  kNotRun,         ///< nothing was estimated
  kOk,             ///< answered
  kWeak,           ///< answered, standard deviation large
  kNotObservable,  ///< a fallback is given; do not trust it
  kFailed,         ///< no answer
};

/// "ok", "weak", "not_observable", "failed", "not_run": the words used in result files.
std::string_view to_string(Status status);

/// Inverse of to_string. @throws std::invalid_argument for an unknown word.
Status status_from_string(std::string_view word);

}  // namespace camber

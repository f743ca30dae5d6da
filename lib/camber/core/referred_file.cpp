#include "camber/core/referred_file.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <set>
#include <sstream>

#include "camber/core/detail/paths.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// "line 3, column 7 (byte 40)" of an error's message, empty where it has none. Words and numbers
/// of a place alone: all else may come from the file.
std::string place_of(const InputError& error) {
  static const std::set<std::string> kWords = {"line", "column", "byte"};
  const std::string start = error.path() + ": ";
  const std::string message = error.what();
  if (message.compare(0, start.size(), start) != 0) return {};
  const std::size_t end = message.find(": ", start.size());
  if (end == std::string::npos) return {};
  const std::string place = message.substr(start.size(), end - start.size());
  std::string bare = place;
  for (char& c : bare) {
    if (c == '(' || c == ')' || c == ',') c = ' ';
  }
  std::istringstream words(bare);
  std::string word;
  for (bool name = true; words >> word; name = !name) {
    const bool number = word.find_first_not_of("0123456789") == std::string::npos;
    if (name ? kWords.count(word) == 0 : !number) return {};
  }
  return place;
}

}  // namespace

bool lies_below(const fs::path& file, const fs::path& folder) {
  std::error_code error;
  const fs::path top = fs::canonical(folder.empty() ? fs::path(".") : folder, error);
  if (error) return false;
  const fs::path whole = fs::weakly_canonical(file, error);
  if (error) return false;
  return paths::lies_in(whole, top);
}

InputError error_without_content(const InputError& error, const std::string& expected) {
  const std::string reason =
      "expected " + expected +
      " that can be read; what was found is not shown, as another file names this one (camber "
      "info shows it)";
  const std::string place = place_of(error);
  return place.empty() ? InputError(error.path(), reason) : InputError(error.path(), place, reason);
}

std::string remarks_without_content(const fs::path& path, std::size_t count) {
  return path.string() + ": " + std::to_string(count) + (count == 1 ? " remark" : " remarks") +
         " on it not shown, as another file names this one (camber info shows more)";
}

void require_readable(const fs::path& path) {
  if (::access(path.c_str(), R_OK) == 0) return;
  const int reason = errno;
  throw InputError(path.string(), reason == ENOENT || reason == ENOTDIR
                                      ? "no such file"
                                      : std::string("cannot be opened: ") + std::strerror(reason));
}

}  // namespace camber

#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "camber/core/errors.h"
#include "camber/core/progress.h"

namespace camber {

/// Whether a file lies in a folder or below it once links are followed.
bool lies_below(const std::filesystem::path& file, const std::filesystem::path& folder);

/// A file that names one outside the folder to which it is confined. Shows nothing of the name.
class OutsideFolderError : public InputError {
 public:
  explicit OutsideFolderError(const std::string& path)
      : InputError(path,
                   "names a file elsewhere, expected one that stays in the manifest's folder "
                   "(--confine)") {}
};

/// Why a file that another file names could not be read, without anything of what it holds.
/// @param expected  "a point cloud", "a scene manifest"
InputError error_without_content(const InputError& error, const std::string& expected);

/// The sentence in place of `count` remarks on a file that another file names.
std::string remarks_without_content(const std::filesystem::path& path, std::size_t count);

/// Refuses a file that is not there or may not be read. @throws InputError.
void require_readable(const std::filesystem::path& path);

/// Calls `read(warn)` for a file that another file names. Who wrote the name may have no right to
/// see the file, so that nothing of what it holds enters a message: errors give the file, the place
/// and what was expected, warnings become one sentence with their number.
/// @param warn  handed on to `read`, in this form; may be empty.
/// @throws InputError.
template <class Read>
auto read_referred_file(const std::filesystem::path& path, const std::string& expected,
                        const LogSink& warn, const Read& read) {
  require_readable(path);
  std::size_t remarks = 0;
  const LogSink count = warn ? LogSink([&remarks](const std::string&) { ++remarks; }) : LogSink();
  try {
    auto out = read(count);
    if (remarks > 0) warn(remarks_without_content(path, remarks));
    return out;
  } catch (const OutsideFolderError&) {
    throw;
  } catch (const InputError& error) {
    throw error_without_content(error, expected);
  }
}

}  // namespace camber

#include "camber/core/protected_inputs.h"

#include <sys/stat.h>

#include <map>
#include <mutex>
#include <utility>

#include "camber/core/detail/paths.h"
#include "camber/core/errors.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Identity = std::pair<dev_t, ino_t>;

struct Inputs {
  std::mutex mutex;
  std::map<Identity, fs::path> names;  // as given
};

/// Never destroyed: other threads may use it while the process ends.
Inputs& inputs() {
  static Inputs* const all = new Inputs;
  return *all;
}

/// Of a file or a folder; devices and pipes can be both read and written.
bool identify(const fs::path& path, Identity* identity) {
  struct stat status {};
  if (path.empty() || ::stat(path.c_str(), &status) != 0) return false;
  *identity = {status.st_dev, status.st_ino};
  return S_ISREG(status.st_mode) || S_ISDIR(status.st_mode);
}

}  // namespace

void protect_inputs(const std::vector<fs::path>& paths) {
  const std::lock_guard<std::mutex> lock(inputs().mutex);
  Identity identity;
  for (const fs::path& path : paths) {
    if (identify(path, &identity)) inputs().names.emplace(identity, path);
  }
}

void refuse_protected_file(const fs::path& path) {
  const std::lock_guard<std::mutex> lock(inputs().mutex);
  Identity identity;
  if (inputs().names.empty() || !identify(path, &identity)) return;
  const auto input = inputs().names.find(identity);
  if (input == inputs().names.end()) return;
  throw UsageError(path.string() + ": is the input " + input->second.string() +
                   (path == input->second ? "" : " under another name") +
                   ", and would be replaced; expected another name");
}

void refuse_protected_folder(const fs::path& path) {
  const fs::path folder = paths::resolved(path);
  std::error_code error;
  if (!fs::is_directory(folder, error)) return refuse_protected_file(path);
  const std::lock_guard<std::mutex> lock(inputs().mutex);
  for (const auto& [identity, input] : inputs().names) {
    if (paths::holds_name(folder, input)) {
      throw UsageError(path.string() + ": holds the input " + input.string() +
                       ", and a result replaces its folder");
    }
  }
}

}  // namespace camber

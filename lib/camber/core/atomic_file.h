#pragma once

#include <filesystem>
#include <functional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

namespace camber {

/// Writes a whole file beside its final name, then renames it: under `path` stands either the old
/// file or the complete new one. A link is followed and stays; devices and pipes are written
/// directly. @throws OutputError (path, reason).
void write_file_atomically(const std::filesystem::path& path,
                           const std::function<void(std::ostream&)>& write);
void write_file_atomically(const std::filesystem::path& path, const std::string& content);

/// Several files that appear together: each is written under the name that stage() gives, commit()
/// renames them all. Without commit() nothing of them remains.
class AtomicFiles {
 public:
  AtomicFiles() = default;
  ~AtomicFiles();
  AtomicFiles(const AtomicFiles&) = delete;
  AtomicFiles& operator=(const AtomicFiles&) = delete;

  /// @return where to write what is to stand under `path`: beside it, same extension.
  /// @throws OutputError (path, reason) if nothing can be written there.
  std::filesystem::path stage(const std::filesystem::path& path);
  void commit();

 private:
  std::vector<std::pair<std::filesystem::path, std::filesystem::path>> staged_;  // beside, final
};

/// A result folder that appears whole. Files are written under staging(); commit() swaps it with
/// the folder at `path`. Without commit() nothing of it remains and what stood there is untouched.
class AtomicFolder {
 public:
  /// @param overwrite allow to replace a non-empty folder that is not a Camber result (one that
  ///                  has a run.json).
  /// @param inputs    what the caller reads: a folder that holds one of them is never replaced.
  /// A link to a folder is followed and stays.
  /// @throws OutputError if a foreign non-empty folder, the current folder or a file stands there,
  ///         or it is not writable. @throws UsageError if it has no name or holds an input.
  AtomicFolder(const std::filesystem::path& path, bool overwrite,
               const std::vector<std::filesystem::path>& inputs = {});
  ~AtomicFolder();
  AtomicFolder(const AtomicFolder&) = delete;
  AtomicFolder& operator=(const AtomicFolder&) = delete;

  const std::filesystem::path& staging() const { return staging_; }
  void commit();

 private:
  std::string name_;  // as given, for messages
  std::filesystem::path path_;
  std::filesystem::path staging_;
};

}  // namespace camber

#pragma once

#include <filesystem>
#include <functional>
#include <ostream>
#include <string>
#include <vector>

namespace camber {

/// Writes a whole file beside its final name, brings it to the disk (fsync), then renames it: under
/// `path` stands either the old file or the complete new one, also after a loss of power. A link is
/// followed and stays; devices and pipes are written directly, and so is what AtomicFiles or
/// AtomicFolder has staged. @throws OutputError (path, reason).
void write_file_atomically(const std::filesystem::path& path,
                           const std::function<void(std::ostream&)>& write);
void write_file_atomically(const std::filesystem::path& path, const std::string& content);

/// Before the work: throws the OutputError that writing a file there would end with (a folder of
/// that name, a folder that is missing or not writable). Writes nothing; an empty name is skipped.
void check_output_file(const std::filesystem::path& path);
/// The same of an AtomicFolder with these arguments; its UsageError too.
void check_output_folder(const std::filesystem::path& path, bool overwrite,
                         const std::vector<std::filesystem::path>& inputs = {});

/// Several files that appear together: each is written under the name that stage() gives, commit()
/// brings them to the disk and renames them all; where that fails for one, all get their old
/// content back. Without commit() nothing of them remains.
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
  struct Staged {
    std::filesystem::path beside, path;
    std::string name;  // as given, for messages
    bool appeared = false, exchanged = false;
  };
  void take_back();
  [[noreturn]] void fail(const std::string& name);
  void discard() noexcept;

  std::vector<Staged> staged_;
};

/// A result folder that appears whole. Files are written under staging(); commit() brings them to
/// the disk and swaps the folder with that at `path`, in one step (renameat2, RENAME_EXCHANGE).
/// Without commit() nothing of it remains and what stood there is untouched.
/// A file system that cannot exchange two names takes two steps: the old folder gets the name
/// ".NAME.camber-old" beside it, then the new one its own. One of the two names always leads to a
/// whole folder: where a killed run left only the first, the next one gives it its name back.
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
  void take_name();
  [[noreturn]] void fail(const char* what) const;

  std::string name_;  // as given, for messages
  std::filesystem::path path_;
  std::filesystem::path staging_;
};

/// Removes what is staged and not committed. Afterwards whoever writes a file or commits waits for
/// good: for a process that is about to end while other threads still compute.
void discard_staged_outputs() noexcept;

}  // namespace camber

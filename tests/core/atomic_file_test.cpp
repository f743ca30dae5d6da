#include "camber/core/atomic_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "camber/core/errors.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

std::string content(const fs::path& path) {
  std::ostringstream out;
  out << std::ifstream(path, std::ios::binary).rdbuf();
  return out.str();
}

std::size_t entries(const fs::path& folder) {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(folder)) ++count;
  return count;
}

TEST(WriteFileAtomically, WritesAndReplacesTheWholeFile) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "file";
  write_file_atomically(path, std::string("first\0text", 10));
  EXPECT_EQ(content(path), std::string("first\0text", 10));
  write_file_atomically(path, "2");
  EXPECT_EQ(content(path), "2");
  EXPECT_EQ(entries(folder.path()), 1u);
}

TEST(WriteFileAtomically, LeavesTheOldFileWhenWritingFails) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "file";
  write_file_atomically(path, "old");
  EXPECT_THROW(write_file_atomically(path,
                                     [](std::ostream& out) {
                                       out << "half of the new";
                                       throw NoAnswerError("stopped");
                                     }),
               NoAnswerError);
  EXPECT_THROW(
      write_file_atomically(path, [](std::ostream& out) { out.setstate(std::ios::badbit); }),
      OutputError);
  EXPECT_EQ(content(path), "old");
  EXPECT_EQ(entries(folder.path()), 1u);
}

TEST(WriteFileAtomically, NamesThePathThatCannotBeWritten) {
  const test::TemporaryFolder folder;
  try {
    write_file_atomically(folder.path() / "no" / "file", "text");
    FAIL();
  } catch (const OutputError& error) {
    EXPECT_EQ(error.exit_code(), 3);
    EXPECT_EQ(error.path(), (folder.path() / "no" / "file").string());
    EXPECT_THAT(error.what(), ::testing::HasSubstr("No such file"));
  }
  EXPECT_THROW(write_file_atomically(folder.path(), "text"), OutputError);
}

TEST(AtomicFolder, AppearsWholeOnCommitAndNotAtAllWithout) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "deep" / "result";
  {
    AtomicFolder result(path, false);
    write_file_atomically(result.staging() / "run.json", "{}");
    EXPECT_FALSE(fs::exists(path));
  }
  EXPECT_FALSE(fs::exists(path));
  EXPECT_EQ(entries(path.parent_path()), 0u);
  {
    AtomicFolder result(path, false);
    write_file_atomically(result.staging() / "run.json", "{}");
    result.commit();
    EXPECT_TRUE(fs::exists(path / "run.json"));
  }
  EXPECT_EQ(content(path / "run.json"), "{}");
  EXPECT_EQ(entries(path.parent_path()), 1u);
}

TEST(AtomicFolder, ReplacesAResultAndNothingOfTheOldOneStays) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "result";
  for (const char* const name : {"first", "second"}) {
    AtomicFolder result(path.string() + "/", false);
    write_file_atomically(result.staging() / "run.json", name);
    write_file_atomically(result.staging() / name, "");
    result.commit();
  }
  EXPECT_EQ(content(path / "run.json"), "second");
  EXPECT_EQ(entries(path), 2u);
  EXPECT_EQ(entries(folder.path()), 1u);
}

TEST(AtomicFolder, DoesNotTouchAForeignFolderUnlessTold) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "photos";
  fs::create_directory(path);
  { AtomicFolder empty_is_fine(path, false); }
  write_file_atomically(path / "cat.jpg", "meow");
  EXPECT_THROW(AtomicFolder(path, false), OutputError);
  EXPECT_EQ(content(path / "cat.jpg"), "meow");
  {
    AtomicFolder told(path, true);
    EXPECT_EQ(content(path / "cat.jpg"), "meow");
    told.commit();
  }
  EXPECT_FALSE(fs::exists(path / "cat.jpg"));
  write_file_atomically(folder.path() / "file", "text");
  EXPECT_THROW(AtomicFolder(folder.path() / "file", true), OutputError);
  EXPECT_EQ(content(folder.path() / "file"), "text");
}

}  // namespace
}  // namespace camber

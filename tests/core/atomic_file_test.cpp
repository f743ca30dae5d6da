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

TEST(WriteFileAtomically, FollowsALinkAndWritesADeviceInPlace) {
  const test::TemporaryFolder folder;
  const fs::path target = folder.path() / "kept" / "file", link = folder.path() / "link";
  fs::create_directory(target.parent_path());
  write_file_atomically(target, "old");
  fs::create_symlink(target, link);
  write_file_atomically(link, "new");
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_EQ(content(target), "new");
  EXPECT_EQ(entries(target.parent_path()), 1u);

  const fs::path null = folder.path() / "null";
  fs::create_symlink("/dev/null", null);
  write_file_atomically(null, "nothing");
  EXPECT_TRUE(fs::is_symlink(null));
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
  EXPECT_THROW(write_file_atomically("/dev/full", "text"), OutputError);
  EXPECT_THROW(write_file_atomically("", "text"), UsageError);

  const std::string longest(255, 'n');
  write_file_atomically(folder.path() / longest, "text");
  EXPECT_EQ(content(folder.path() / longest), "text");
}

TEST(AtomicFiles, AppearTogetherOrNotAtAll) {
  const test::TemporaryFolder folder;
  const fs::path table = folder.path() / "table.csv", plot = folder.path() / "plot.png";
  write_file_atomically(table, "old");
  {
    AtomicFiles files;
    write_file_atomically(files.stage(table), "half");
    EXPECT_EQ(files.stage(plot).extension(), ".png");
    EXPECT_THROW(files.stage(folder.path() / "none" / "plot.png"), OutputError);
    EXPECT_THROW(files.stage(folder.path()), OutputError);
  }
  EXPECT_EQ(content(table), "old");
  EXPECT_EQ(entries(folder.path()), 1u);
  AtomicFiles files;
  write_file_atomically(files.stage(table), "new");
  write_file_atomically(files.stage(plot), "picture");
  EXPECT_EQ(content(table), "old");
  files.commit();
  EXPECT_EQ(content(table), "new");
  EXPECT_EQ(content(plot), "picture");
  EXPECT_EQ(entries(folder.path()), 2u);
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

TEST(AtomicFolder, NeverReplacesAFolderThatHoldsAnInputOrTheCurrentFolder) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "scene";
  fs::create_directories(path / "images");
  write_file_atomically(path / "run.json", "{}");
  write_file_atomically(path / "images" / "0.png", "picture");
  fs::create_directory_symlink(path, folder.path() / "link");
  for (const fs::path& input : {path, path / "images" / "0.png", folder.path() / "link/run.json"}) {
    EXPECT_THROW(AtomicFolder(path, true, {"elsewhere", input}), UsageError) << input;
    EXPECT_THROW(AtomicFolder(folder.path() / "link", false, {input}), UsageError) << input;
  }
  { AtomicFolder beside(folder.path() / "scene2", false, {path, ""}); }
  { AtomicFolder below(path / "result", false, {path}); }
  EXPECT_THROW(AtomicFolder("", false), UsageError);

  const fs::path before = fs::current_path();
  fs::current_path(path / "images");
  EXPECT_THROW(AtomicFolder(".", true), OutputError);
  EXPECT_THROW(AtomicFolder("..", true), OutputError);
  fs::current_path(before);
  EXPECT_EQ(content(path / "images" / "0.png"), "picture");
}

TEST(AtomicFolder, FollowsALinkAndTakesADotAtTheEnd) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "disk" / "result", link = folder.path() / "link";
  fs::create_directories(path);
  fs::create_directory_symlink(path, link);
  for (const fs::path& given : {link, link / "", path / "."}) {
    AtomicFolder result(given, false);
    write_file_atomically(result.staging() / "run.json", given.string());
    result.commit();
    EXPECT_EQ(content(path / "run.json"), given.string());
  }
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_EQ(entries(path.parent_path()), 1u);
}

}  // namespace
}  // namespace camber

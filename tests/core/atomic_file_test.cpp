#include "camber/core/atomic_file.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <sstream>
#include <thread>

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

/// A number that no process has: that of one that has ended.
pid_t dead_process() {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ::waitpid(child, nullptr, 0);
  return child;
}

TEST(AtomicFiles, AreWrittenInPlaceWhereTheyAreStagedAndNamedAsTheyWillBe) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "file.txt";
  AtomicFiles files;
  const fs::path beside = files.stage(path);
  EXPECT_EQ(entries(folder.path()), 1u);
  write_file_atomically(beside, "text");
  EXPECT_EQ(entries(folder.path()), 1u);
  const auto message_of = [](const fs::path& written) {
    try {
      write_file_atomically(written, [](std::ostream& out) { out.setstate(std::ios::badbit); });
    } catch (const OutputError& error) {
      return error.path();
    }
    return std::string();
  };
  EXPECT_EQ(message_of(beside), path.string());
  AtomicFolder result(folder.path() / "result", false);
  EXPECT_EQ(message_of(result.staging() / "a" / "b"), (folder.path() / "result/a/b").string());
}

TEST(AtomicFiles, GetTheirOldContentBackWhereOneCannotAppear) {
  const test::TemporaryFolder folder;
  const fs::path first = folder.path() / "first", second = folder.path() / "second",
                 third = folder.path() / "third";
  write_file_atomically(first, "old");
  AtomicFiles files;
  for (const fs::path& path : {first, second, third}) {
    write_file_atomically(files.stage(path), "new");
  }
  // A folder of the name of one of them has come in between.
  fs::create_directories(third / "full");
  EXPECT_THROW(files.commit(), OutputError);
  EXPECT_EQ(content(first), "old");
  EXPECT_FALSE(fs::exists(second));
  EXPECT_TRUE(fs::exists(third / "full"));
}

TEST(AtomicFiles, WhatKilledRunsLeftIsRemovedByTheNext) {
  const test::TemporaryFolder folder;
  const std::string dead = std::to_string(dead_process()), alive = std::to_string(::getppid());
  const fs::path left_file = folder.path() / (".a.csv.camber." + dead + ".0.csv"),
                 left_folder = folder.path() / (".b.camber." + dead + ".12"),
                 used = folder.path() / (".a.camber." + dead + ".1");
  const std::vector<fs::path> foreign = {
      folder.path() / (".a.camber." + alive + ".0"), folder.path() / (".a.camber." + dead),
      folder.path() / ("a.camber." + dead + ".0"),   folder.path() / (".camber." + dead + ".0"),
      folder.path() / (".a.camber." + dead + ".0x"), folder.path() / ".a.camber.."};
  for (const fs::path& path : foreign) std::ofstream(path) << "foreign";
  for (const fs::path& path : {left_file, used}) std::ofstream(path) << "half";
  fs::create_directories(left_folder / "truth");
  std::ofstream(left_folder / "truth" / "half") << "half";
  const int lock = ::open(used.c_str(), O_RDONLY);  // as by a process of another container
  ASSERT_EQ(::flock(lock, LOCK_SH), 0);
  write_file_atomically(folder.path() / "other", "text");
  ::close(lock);
  EXPECT_FALSE(fs::exists(left_file));
  EXPECT_FALSE(fs::exists(left_folder));
  EXPECT_EQ(content(used), "half");
  for (const fs::path& path : foreign) EXPECT_EQ(content(path), "foreign") << path;
}

TEST(AtomicFolder, AResultUnderItsOtherNameIsTakenBack) {
  // A file system that cannot exchange names, and a run that was killed between the two steps.
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "result", old = folder.path() / ".result.camber-old";
  fs::create_directory(old);
  write_file_atomically(old / "run.json", "old");
  { AtomicFolder unfinished(path, false); }
  EXPECT_EQ(content(path / "run.json"), "old");
  EXPECT_FALSE(fs::exists(old));
  // After them the old one is no longer needed.
  fs::create_directory(old);
  { AtomicFolder unfinished(path, false); }
  EXPECT_EQ(content(path / "run.json"), "old");
  EXPECT_FALSE(fs::exists(old));
}

TEST(StagedOutputs, AreGoneBeforeAProcessThatStillComputesEnds) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "result";
  const pid_t child = ::fork();
  if (child == 0) {
    AtomicFolder result(path, false);
    AtomicFiles files;
    write_file_atomically(result.staging() / "run.json", "half");
    files.stage(folder.path() / "file");
    std::thread busy([&] { write_file_atomically(result.staging() / "more", "half"); });
    busy.join();
    discard_staged_outputs();
    std::thread late([&] { write_file_atomically(folder.path() / "late", "half"); });
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    ::_exit(17);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(WEXITSTATUS(status), 17);
  EXPECT_EQ(entries(folder.path()), 0u);
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

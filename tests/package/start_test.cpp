// What the program loads: a command that needs little starts at once.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::read_text;
using testing::AllOf;
using testing::ContainsRegex;
using testing::Each;
using testing::HasSubstr;
using testing::Not;

namespace {

/// The shared objects that a run loads from its start to its end, by the dynamic linker's own list.
std::set<std::string> loaded_by(const std::string& arguments, int expected_exit_code = 0) {
  const camber::test::TemporaryFolder folder;
  const std::string report = (folder.path() / "linker").string();
  const std::string command = "cd '" + folder.path().string() +
                              "' && LD_DEBUG=files LD_DEBUG_OUTPUT='" + report +
                              "' '" CAMBER_PROGRAM "' " + arguments + " >/dev/null 2>&1 </dev/null";
  const int status = std::system(command.c_str());
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == expected_exit_code) << arguments;
  std::set<std::string> objects;
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    if (entry.path().filename().string().rfind("linker.", 0) != 0) continue;
    std::istringstream lines(read_text(entry.path()));
    const std::string mark = "calling init: ";
    for (std::string line; std::getline(lines, line);) {
      const auto at = line.find(mark);
      if (at != std::string::npos) objects.insert(line.substr(at + mark.size()));
    }
  }
  EXPECT_THAT(objects, testing::Contains(HasSubstr("libc.so"))) << "the linker told nothing";
  return objects;
}

const auto is_for_drawing =
    ContainsRegex("libvtk|libopencv_(imgcodecs|videoio|highgui)|libgdal|libproj");

std::string small_cloud() {
  return "'" + (camber::test::source_dir() / "samples/steep_hill/truth/road.ply").string() + "'";
}

#ifdef CAMBER_HARDENED
std::string readelf(const std::string& options, const fs::path& file) {
  const camber::test::TemporaryFolder folder;
  const fs::path out = folder.path() / "out";
  const std::string command =
      "readelf " + options + " '" + file.string() + "' > '" + out.string() + "'";
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
  return read_text(out);
}

TEST(Hardening, OfTheProgramAndItsPlugins) {
  std::vector<fs::path> files = {CAMBER_PROGRAM};
  for (const auto& entry : fs::directory_iterator(CAMBER_PLUGINS)) {
    if (entry.path().extension() == ".so") files.push_back(entry.path());
  }
  ASSERT_GE(files.size(), 4u);
  int fortified = 0;
  for (const fs::path& file : files) {
    SCOPED_TRACE(file.filename());
    EXPECT_THAT(readelf("-hW", file), ContainsRegex("Type: +DYN"));  // at any address
    EXPECT_THAT(readelf("-lW", file), HasSubstr("GNU_RELRO"));
    EXPECT_THAT(readelf("-dW", file), ContainsRegex("BIND_NOW|Flags:.*NOW"));
    const std::string symbols = readelf("--dyn-syms -W", file);
    EXPECT_THAT(symbols, HasSubstr("__stack_chk_fail"));
    fortified += symbols.find("_chk@") != std::string::npos;
  }
  EXPECT_GE(fortified, 1);
}
#endif

TEST(Start, TheVersionTakesTheFrontAlone) {
  EXPECT_LE(loaded_by("--version").size(), 10u);
  EXPECT_LE(loaded_by("--help").size(), 10u);
  EXPECT_LE(loaded_by("no-such-command", 2).size(), 10u);
}

TEST(Start, CommandsOnCloudsLoadNoOpenCvAndNoVtk) {
  for (const std::string& arguments :
       {"plane " + small_cloud() + " --threshold 0.05 --json",
        "ground " + small_cloud() + " --out ground.ply",
        "patches " + small_cloud() + " --out patches", "info " + small_cloud(),
        "filter " + small_cloud() + " --out filtered.pcd", std::string("convert --help"),
        std::string("export --help"), std::string("lift --help"), std::string("view --help")}) {
    SCOPED_TRACE(arguments);
    const std::set<std::string> objects = loaded_by(arguments);
    EXPECT_LE(objects.size(), 40u);
    EXPECT_THAT(objects, Each(AllOf(Not(HasSubstr("libopencv")), Not(HasSubstr("libvtk")),
                                    Not(HasSubstr("libgdal")), Not(HasSubstr("libproj")),
                                    Not(HasSubstr("libpcl_segmentation")))));
  }
}

TEST(Start, NoCommandLoadsWhatDrawsBeforeItDraws) {
  for (const char* command :
       {"detect", "reconstruct", "drive", "triangulate", "vehicles", "profile", "compare",
        "evaluate", "render", "import kitti", "prior info", "synth"}) {
    SCOPED_TRACE(command);
    EXPECT_THAT(loaded_by(std::string(command) + " --help"), Each(Not(is_for_drawing)));
  }
  EXPECT_THAT(
      loaded_by("reconstruct '" + (camber::test::source_dir() / "samples/steep_hill").string() +
                "' --no-pictures --out result"),
      Each(Not(is_for_drawing)));
}

TEST(Start, APictureLoadsVtkAndNoFormatsOfImagesAndFilms) {
  const std::set<std::string> objects =
      loaded_by("render " + small_cloud() + " --view bev --out bev.png");
  EXPECT_THAT(objects, testing::Contains(HasSubstr("libcamber_vtk.so")));
  EXPECT_THAT(objects, Each(Not(ContainsRegex("libopencv_(imgcodecs|videoio)|libgdal"))));
}

TEST(Start, WithoutItsPluginACommandSaysSo) {
  const camber::test::TemporaryFolder folder;
  fs::create_directories(folder.path() / "bin");
  fs::copy_file(CAMBER_PROGRAM, folder.path() / "bin/camber");
  const std::string camber = "'" + (folder.path() / "bin/camber").string() + "' ";
  const std::string err = (folder.path() / "err").string();
  EXPECT_EQ(std::system((camber + "--version >/dev/null").c_str()), 0);
  const int status = std::system((camber + "plane x.ply 2>'" + err + "'").c_str());
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 3);
  EXPECT_THAT(read_text(err),
              ContainsRegex("^camber: [^\n]*/libcamber_clouds.so: no such file[^\n]*\n$"));
}

/// A program as it is built where the library of one plugin is not installed.
void expect_refused_without(const std::string& plugin, const std::string& arguments,
                            const std::string& package) {
  const camber::test::TemporaryFolder folder;
  const fs::path plugins = fs::path(CAMBER_PLUGINS);
  const fs::path program = fs::path(CAMBER_PROGRAM);
  const fs::path beside =
      folder.path() / fs::relative(plugins, program.parent_path().parent_path());
  fs::create_directories(folder.path() / "bin");
  fs::create_directories(beside);
  fs::copy_file(program, folder.path() / "bin/camber");
  for (const auto& entry : fs::directory_iterator(plugins)) {
    if (entry.path().filename() == "libcamber_" + plugin + ".so") continue;
    fs::create_symlink(entry.path(), beside / entry.path().filename());
  }
  const std::string err = (folder.path() / "err").string();
  const std::string command = "'" + (folder.path() / "bin/camber").string() + "' " + arguments +
                              " --out '" + (folder.path() / "out").string() + "' 2>'" + err + "'";
  const int status = std::system(command.c_str());
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 3);
  EXPECT_THAT(read_text(err),
              ContainsRegex("^camber: [^\n]*" + package + "[^\n]*install it[^\n]*\n$"));
  EXPECT_FALSE(fs::exists(folder.path() / "out"));
}

TEST(Start, WithoutRossLibraryBagsAreRefused) {
  expect_refused_without("rosbag", "import rosbag x.bag", "librosbag-storage-dev");
}

TEST(Start, WithoutGdalGeoTiffIsRefused) {
  expect_refused_without("gdal", "export " + small_cloud() + " --along x.csv --to geotiff",
                         "libgdal-dev");
}

}  // namespace

// The viewer under Xvfb: it starts, shows the scene, and reacts to keys and clicks.

#include "viewer_window.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <QVTKOpenGLNativeWidget.h>
#include <QApplication>
#include <QCheckBox>
#include <QTest>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/render/picture_file.h"
#include "camber/scene/results.h"
#include "cli/run_program.h"
#include "render/picture_content.h"
#include "scene/write_image.h"
#include "support/test_data.h"
#include "support/virtual_display.h"

#if defined(__SANITIZE_ADDRESS__)
/// Qt's fonts and Mesa keep memory to the end of the process: no leaks of ours.
extern "C" const char* __asan_default_options();
extern "C" const char* __asan_default_options() { return "detect_leaks=0"; }
#endif

namespace camber {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

int count_red(const Image& image) {
  int count = 0;
  for (std::size_t i = 0; i < image.data.size(); i += 3) {
    const std::uint8_t* p = &image.data[i];
    count += std::abs(p[0] - 214) < 30 && std::abs(p[1] - 24) < 45 && std::abs(p[2] - 30) < 45;
  }
  return count;
}

int count_inked(const Image& image) {
  int count = 0;
  for (std::size_t i = 0; i < image.data.size(); i += 3) {
    count += image.data[i] != 255 || image.data[i + 1] != 255 || image.data[i + 2] != 255;
  }
  return count;
}

class Viewer : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    display_ = new test::VirtualDisplay("1000x640x24");
    if (display_->number().empty()) return;
    ::setenv("DISPLAY", (":" + display_->number()).c_str(), 1);
    ::setenv("XDG_RUNTIME_DIR", "/tmp", 0);
    QSurfaceFormat::setDefaultFormat(QVTKOpenGLNativeWidget::defaultFormat());
    static int argc = 1;
    static char name[] = "test_viewers";
    static char* argv[] = {name, nullptr};
    application_ = new QApplication(argc, argv);
  }
  static void TearDownTestSuite() {
    delete application_;
    application_ = nullptr;
    delete display_;
    display_ = nullptr;
  }

  void SetUp() override {
    if (display_->number().empty()) GTEST_SKIP() << "no Xvfb on this machine";
    const test::PictureScene made;
    LoadedResult result;
    result.cloud = made.cloud;
    result.cloud->sigmas.assign(made.cloud.size(), 0.02f);
    result.cloud->sigmas[7] = 0.3f;
    result.cloud->labels["patch"].assign(made.cloud.size(), 0);
    result.surface = made.surface;
    result.vehicles = made.vehicles;
    result.vehicles->frames.push_back({8, {made.vehicles.frames[0].vehicles[0]}});
    result.run = made.run;
    Scene scene;
    scene.name = "a road that climbs";
    scene.camera = made.camera;
    scene.truth = made.truth;
    // Their boxes say which true vehicle an estimate is.
    const Box2 box{40.0, 20.0, 70.0, 40.0};
    result.vehicles->frames[0].vehicles[0].box = box;
    scene.truth->frames[0].vehicles[0].box = box;
    write_png(make_picture(made.camera.width, made.camera.height, 120), path("7.png"));
    SceneFrame frame;
    frame.id = 7;
    frame.image = path("7.png");
    scene.frames.push_back(frame);
    result.scene = scene;
    ViewerOptions options;
    options.frame = 7;
    options.title = scene.name;
    options.snapshots = path("snapshot");
    window_ = std::make_unique<ViewerWindow>(std::move(result), options);
    ASSERT_TRUE(QTest::qWaitForWindowExposed(window_.get()));
    settle();
  }

  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  static void settle() { QTest::qWait(50); }
  void press(Qt::Key key) {
    QTest::keyClick(window_->scene_widget(), key);
    settle();
  }
  void click(const Eigen::Vector3d& place) {
    QPoint at;
    ASSERT_TRUE(window_->project(place, &at));
    QTest::mouseClick(window_->scene_widget(), Qt::LeftButton, {}, at);
    settle();
  }
  /// The picture that the snapshot key writes next.
  Image snapshot() {
    press(Qt::Key_S);
    EXPECT_THAT(window_->message(), StartsWith("wrote "));
    const std::string file = window_->message().substr(6);
    return std::filesystem::exists(file) ? read_color_image(file) : make_picture(1, 1, 255);
  }

  static test::VirtualDisplay* display_;
  static QApplication* application_;
  test::TemporaryFolder folder_;
  std::unique_ptr<ViewerWindow> window_;
};
test::VirtualDisplay* Viewer::display_ = nullptr;
QApplication* Viewer::application_ = nullptr;

TEST_F(Viewer, ShowsTheSceneAndItsImage) {
  const Image picture = snapshot();
  EXPECT_GE(picture.width, 500);
  // A view that shows next to nothing would be mostly paper.
  EXPECT_GT(count_inked(picture), picture.width * picture.height / 20);
  EXPECT_GT(count_red(picture), 40);
  EXPECT_TRUE(window_->has_image());
  EXPECT_EQ(window_->windowTitle().toStdString(), "a road that climbs - Camber");
}

TEST_F(Viewer, KeysAndBoxesSwitchParts) {
  const int inked = count_inked(snapshot());
  EXPECT_TRUE(window_->shows(SceneElement::kTruth));
  press(Qt::Key_T);
  EXPECT_FALSE(window_->shows(SceneElement::kTruth));
  EXPECT_LT(count_red(snapshot()), 5);
  auto* points = window_->findChild<QCheckBox*>("points");
  ASSERT_NE(points, nullptr);
  EXPECT_TRUE(points->isChecked());
  QTest::mouseClick(points, Qt::LeftButton, {}, QPoint(8, points->height() / 2));
  settle();
  EXPECT_FALSE(window_->shows(SceneElement::kPoints));
  EXPECT_LT(count_inked(snapshot()), inked * 2 / 3);
  press(Qt::Key_P);
  EXPECT_TRUE(points->isChecked());
  // There is no dense truth: its key says so, and nothing else changes.
  press(Qt::Key_D);
  EXPECT_THAT(window_->message(), HasSubstr("no dense ground truth"));
  EXPECT_FALSE(window_->shows(SceneElement::kTruthCloud));
}

TEST_F(Viewer, AClickTellsWhatIsThere) {
  const PictureSpace& space = window_->space();
  click(space.vehicles[0].box.center());
  EXPECT_THAT(window_->facts(), StartsWith("car 1 in frame 7: ok"));
  EXPECT_THAT(window_->facts(), HasSubstr("length 4.40, width 1.80, height 1.50 m"));
  // The truth was made 0.5 m to the side and 1 m behind.
  EXPECT_THAT(window_->facts(), HasSubstr("its centre is 1.12 m away"));

  // A road point away from cars and patches.
  std::size_t far = 0;
  for (std::size_t i = 0; i < space.points.size(); ++i) {
    if (space.kept[i] == 40 * 60 + 20) far = i;  // row 60, column 20: x = 0, z = 22
  }
  click(space.points[far].cast<double>());
  EXPECT_THAT(window_->facts(), StartsWith("point "));
  EXPECT_THAT(window_->facts(), HasSubstr("sigma 0.020 m"));
  EXPECT_THAT(window_->facts(), HasSubstr("patch 0: road, ok"));
  const std::string facts = window_->facts();
  double right = 1e9, ahead = 1e9, up = 1e9;
  const auto at = facts.find("right ");
  ASSERT_NE(at, std::string::npos);
  ASSERT_EQ(std::sscanf(facts.c_str() + at, "right %lf, ahead %lf, up %lf", &right, &ahead, &up),
            3);
  EXPECT_NEAR(right, 0.0, 0.6);  // points lie 0.25 and 0.3 m apart; neighbours count as hits
  EXPECT_NEAR(ahead, 22.0, 1.0);
  EXPECT_NEAR(up, 0.08 * 22.0, 0.1);

  // The corner of the window shows paper.
  QTest::mouseClick(window_->scene_widget(), Qt::LeftButton, {}, QPoint(3, 3));
  EXPECT_EQ(window_->facts(), "nothing here");
  press(Qt::Key_Escape);
  EXPECT_THAT(window_->facts(), StartsWith("Click a point"));
}

TEST_F(Viewer, ADragTurnsTheSceneAndIsNoClick) {
  const Image before = snapshot();
  QWidget* view = window_->scene_widget();
  const QPoint middle = view->rect().center();
  QTest::mousePress(view, Qt::LeftButton, {}, middle);
  for (int i = 1; i <= 6; ++i) {
    const QPoint to = middle + QPoint(20 * i, 5 * i);
    QMouseEvent move(QEvent::MouseMove, to, view->mapToGlobal(to), Qt::NoButton, Qt::LeftButton,
                     Qt::NoModifier);
    QApplication::sendEvent(view, &move);
  }
  QTest::mouseRelease(view, Qt::LeftButton, {}, middle + QPoint(120, 30));
  settle();
  EXPECT_THAT(window_->facts(), StartsWith("Click a point"));
  EXPECT_NE(snapshot().data, before.data);
  press(Qt::Key_1);
  EXPECT_EQ(snapshot().data, before.data);
}

TEST_F(Viewer, StepsThroughFramesColoursAndSizes) {
  EXPECT_EQ(window_->frame(), 7);
  EXPECT_EQ(window_->space().vehicles.size(), 2u);
  press(Qt::Key_Right);
  EXPECT_EQ(window_->frame(), 8);
  EXPECT_EQ(window_->space().vehicles.size(), 1u);
  EXPECT_FALSE(window_->has_image());  // the scene has none of this frame
  press(Qt::Key_Right);
  EXPECT_EQ(window_->frame(), 8);
  press(Qt::Key_Left);
  EXPECT_EQ(window_->frame(), 7);
  EXPECT_TRUE(window_->has_image());

  EXPECT_EQ(window_->color(), "height");
  const Image by_height = snapshot();
  press(Qt::Key_M);
  EXPECT_EQ(window_->color(), "sigma");
  EXPECT_NE(snapshot().data, by_height.data);
  const double size = window_->point_size();
  press(Qt::Key_Plus);
  EXPECT_EQ(window_->point_size(), size + 1.0);
  press(Qt::Key_Minus);
  press(Qt::Key_Minus);
  EXPECT_EQ(window_->point_size(), size - 1.0);
}

TEST_F(Viewer, ViewsAndHelpHaveKeys) {
  std::vector<Image> seen = {snapshot()};
  for (const Qt::Key key : {Qt::Key_2, Qt::Key_3, Qt::Key_4}) {
    press(key);
    const Image picture = snapshot();
    EXPECT_GT(count_inked(picture), picture.width * picture.height / 100) << "key " << key;
    for (const Image& other : seen) EXPECT_NE(picture.data, other.data);
    seen.push_back(picture);
  }
  EXPECT_FALSE(window_->help_shown());
  press(Qt::Key_H);
  EXPECT_TRUE(window_->help_shown());
  press(Qt::Key_H);
  EXPECT_FALSE(window_->help_shown());
  QTest::keyClick(window_->scene_widget(), Qt::Key_Q);
  settle();
  EXPECT_FALSE(window_->isVisible());
}

TEST_F(Viewer, SaysWhereAPictureCannotBeWritten) {
  LoadedResult result;
  result.cloud = test::PictureScene().cloud;
  ViewerOptions options;
  options.snapshots = path("none/there");
  ViewerWindow other(std::move(result), options);
  ASSERT_TRUE(QTest::qWaitForWindowExposed(&other));
  QTest::keyClick(other.scene_widget(), Qt::Key_S);
  EXPECT_THAT(other.message(), HasSubstr("cannot be written"));
}

TEST_F(Viewer, AResultUpToScaleHasNoKnownScale) {
  const test::PictureScene made;
  for (const bool metric : {true, false}) {
    LoadedResult result;
    result.cloud = made.cloud;
    result.run = made.run;
    result.run->metric = metric;
    result.run->scale_sigma = 0.016;
    const ViewerWindow other(std::move(result), ViewerOptions());
    EXPECT_EQ(other.facts().find("scale known to 1.6 %") != std::string::npos, metric);
    EXPECT_EQ(other.facts().find("up to scale") == std::string::npos, metric);
  }
}

class ViewCommand : public testing::Test {
 protected:
  ViewCommand() {
    write_cloud(test::PictureScene().cloud, cloud());
    test::write_bytes(path("nan.xyz"), "x y z\nnan nan nan\nnan nan nan\n");
  }
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  std::string cloud() const { return path("cloud.ply"); }
  test::TemporaryFolder folder_;
};

TEST_F(ViewCommand, WithoutADisplayPointsToRender) {
  ::unsetenv("DISPLAY");
  ::unsetenv("QT_QPA_PLATFORM");
  EXPECT_ONE_SENTENCE(test::run_camber({"view", cloud()}), 3, "camber render draws pictures");
  ::setenv("DISPLAY", ":54321", 1);
  EXPECT_ONE_SENTENCE(test::run_camber({"view", cloud()}), 3, "does not answer");
  ::unsetenv("DISPLAY");
}

TEST_F(ViewCommand, SaysWhatCannotBeOpened) {
  ::unsetenv("DISPLAY");
  EXPECT_ONE_SENTENCE(test::run_camber({"view", path("none.ply")}), 2, "no such file or folder");
  test::write_bytes(path("broken.ply"), "ply\nformat ascii 1.0\nelement vertex 3\n");
  EXPECT_ONE_SENTENCE(test::run_camber({"view", path("broken.ply")}), 2, "broken.ply");
  EXPECT_ONE_SENTENCE(test::run_camber({"view", path("nan.xyz")}), 1, "finite coordinates");
  EXPECT_ONE_SENTENCE(test::run_camber({"view", cloud(), "--picture", path("window.jpg")}), 2,
                      "expected FILE.png");
  std::filesystem::create_directories(path("result"));
  write_cloud(test::PictureScene().cloud, path("result/road.ply"));
  RunDocument document = test::PictureScene().run;
  document.scene.clear();
  write_json(to_json(document), path("result/run.json"));
  EXPECT_ONE_SENTENCE(test::run_camber({"view", path("result"), "--frame", "77"}), 2,
                      "--frame: found 77, expected one of the frames of");
}

TEST_F(ViewCommand, WithoutOpenGLThereIsNoPicture) {
  ::unsetenv("DISPLAY");
  ::setenv("QT_QPA_PLATFORM", "offscreen", 1);
  const auto run = test::run_camber({"view", cloud(), "--picture", path("window.png")});
  ::unsetenv("QT_QPA_PLATFORM");
  EXPECT_EQ(run.exit_code, 3);
  EXPECT_THAT(run.error, HasSubstr("no OpenGL"));
  EXPECT_FALSE(std::filesystem::exists(path("window.png")));
}

TEST_F(ViewCommand, WritesAPictureOfItsWindow) {
  const test::VirtualDisplay display("1000x640x24");
  if (display.number().empty()) GTEST_SKIP() << "no Xvfb on this machine";
  ::setenv("DISPLAY", (":" + display.number()).c_str(), 1);
  const auto run = test::run_camber({"view", cloud(), "--picture", path("window.png")});
  EXPECT_EQ(run.exit_code, 0) << run.error;
  const Image seen = read_color_image(path("window.png"));
  EXPECT_EQ(seen.width, 1000);  // the display is smaller than the window would be
  EXPECT_GT(count_inked(seen), seen.width * seen.height / 5);  // the side's ground is grey
  EXPECT_EQ(test::run_camber({"view", cloud(), "--picture", path("none/window.png")}).exit_code, 3);
  EXPECT_FALSE(std::filesystem::exists(path("none")));
  ::unsetenv("DISPLAY");
}

TEST_F(ViewCommand, TellsWhatItShowedAndWroteAsJson) {
  const test::VirtualDisplay display("1000x640x24");
  if (display.number().empty()) GTEST_SKIP() << "no Xvfb on this machine";
  ::setenv("DISPLAY", (":" + display.number()).c_str(), 1);
  const std::string picture = path("window.png");
  const auto run = test::run_camber(
      {"view", cloud(), "--picture", picture, "--color", "height", "--seed", "5", "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const auto out = nlohmann::json::parse(run.out);
  EXPECT_EQ(out.at("version"), kVersion);
  EXPECT_EQ(out.at("seed"), 5);
  EXPECT_EQ(out.at("file"), cloud());
  EXPECT_EQ(out.at("scene"), "");
  EXPECT_EQ(out.at("points"), test::PictureScene().cloud.size());
  EXPECT_EQ(out.at("patches"), 0);
  EXPECT_EQ(out.at("files"), nlohmann::json({picture}));
  EXPECT_EQ(out.at("options").at("color"), "height");
  EXPECT_EQ(out.at("options").at("picture"), picture);
  EXPECT_TRUE(out.at("options").at("frame").is_null());
  for (const char* stage : {"load", "compute", "write"}) {
    EXPECT_GT(out.at("timings_ms").at(stage), 0.0) << stage;
  }
  // A picture that cannot be written is no result.
  const auto failed =
      test::run_camber({"view", cloud(), "--picture", path("none/window.png"), "--json"});
  EXPECT_EQ(failed.exit_code, 3);
  EXPECT_EQ(failed.out, "");
  ::unsetenv("DISPLAY");
}

TEST_F(ViewCommand, IsQuietWhereItIsTold) {
  const test::VirtualDisplay display("1000x640x24");
  if (display.number().empty()) GTEST_SKIP() << "no Xvfb on this machine";
  ::setenv("DISPLAY", (":" + display.number()).c_str(), 1);
  // A result whose scene is gone.
  std::filesystem::create_directories(path("result"));
  write_cloud(test::PictureScene().cloud, path("result/road.ply"));
  RunDocument document;
  document.scene = path("gone/scene.json");
  write_json(to_json(document), path("result/run.json"));
  std::vector<std::string> words = {"view", path("result"), "--picture", path("window.png")};
  EXPECT_THAT(test::run_camber(words).error, HasSubstr("camber: warning: "));
  words.emplace_back("--quiet");
  const auto quiet = test::run_camber(words);
  EXPECT_EQ(quiet.exit_code, 0);
  EXPECT_THAT(quiet.error, testing::Not(HasSubstr("warning")));
  ::unsetenv("DISPLAY");
}

TEST_F(ViewCommand, SaysThatTheViewerIsMissing) {
  // The program and its plugins without the viewer, as where Qt is not installed.
  const std::filesystem::path program(CAMBER_PROGRAM);
  std::filesystem::create_directories(path("bin"));
  std::filesystem::copy_file(program, path("bin/camber"));
  std::filesystem::create_directory_symlink(program.parent_path().parent_path() / "lib",
                                            path("lib"));
  const std::string run =
      "'" + path("bin/camber") + "' view '" + cloud() + "' 2>'" + path("said") + "'";
  const int status = std::system(run.c_str());
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 3);
  std::ifstream in(path("said"));
  std::string said;
  std::getline(in, said);
  EXPECT_THAT(said, StartsWith("camber: the interactive viewer camber-view is not beside"));
  EXPECT_THAT(said, HasSubstr("camber render draws pictures without it"));
}

/// Runs a shell command until it succeeds, for at most ten seconds.
bool eventually(const std::string& command) {
  for (int i = 0; i < 100; ++i) {
    if (std::system((command + " >/dev/null 2>&1").c_str()) == 0) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return false;
}

TEST_F(ViewCommand, OpensAWindowThatTakesRealKeys) {
  if (std::system("command -v xdotool >/dev/null 2>&1") != 0) GTEST_SKIP() << "no xdotool";
  const test::VirtualDisplay display("1000x640x24");
  if (display.number().empty()) GTEST_SKIP() << "no Xvfb on this machine";
  ::setenv("DISPLAY", (":" + display.number()).c_str(), 1);
  test::ProgramResult result;
  std::thread program([&] {
    result = test::run_camber({"view", cloud(), "--snapshots", path("seen"), "--json"}, 0);
  });
  EXPECT_TRUE(eventually("xdotool search --onlyvisible --name Camber"));
  // A window without a manager gets its keys where the pointer is.
  const bool drawn =
      eventually("xdotool mousemove 400 400 && xdotool key s && sleep 0.4 && test -s '" +
                 path("seen-1.png") + "'");
  EXPECT_TRUE(drawn);
  const bool closed =
      eventually("xdotool key q; sleep 0.3; ! xdotool search --onlyvisible --name Camber");
  EXPECT_TRUE(closed);
  program.join();
  EXPECT_EQ(result.exit_code, 0) << result.error;
  ASSERT_TRUE(std::filesystem::exists(path("seen-1.png")));
  const auto out = nlohmann::json::parse(result.out, nullptr, false);
  ASSERT_TRUE(out.is_object()) << result.out;
  EXPECT_EQ(out.at("files").at(0), path("seen-1.png"));
  const Image seen = read_color_image(path("seen-1.png"));
  EXPECT_GT(count_inked(seen), seen.width * seen.height / 20);
  ::unsetenv("DISPLAY");
}

}  // namespace
}  // namespace camber

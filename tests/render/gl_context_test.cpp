#include "camber/render/gl_context.h"

#include <gtest/gtest.h>
#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkUnsignedCharArray.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "camber/core/errors.h"
#include "support/virtual_display.h"

namespace camber {
namespace {

/// A green triangle over the lower left half of a grey window; rows from the bottom.
std::vector<unsigned char> render_triangle(OffscreenWindow& offscreen, int width, int height) {
  vtkNew<vtkPoints> points;
  points->InsertNextPoint(-1, -1, 0);
  points->InsertNextPoint(1, -1, 0);
  points->InsertNextPoint(-1, 1, 0);
  vtkNew<vtkCellArray> triangles;
  const vtkIdType corners[3] = {0, 1, 2};
  triangles->InsertNextCell(3, corners);
  vtkNew<vtkPolyData> data;
  data->SetPoints(points);
  data->SetPolys(triangles);
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputData(data);
  vtkNew<vtkActor> actor;
  actor->SetMapper(mapper);
  actor->GetProperty()->SetColor(0, 1, 0);
  actor->GetProperty()->LightingOff();
  vtkNew<vtkRenderer> renderer;
  renderer->SetBackground(0.2, 0.2, 0.2);
  renderer->AddActor(actor);
  renderer->GetActiveCamera()->ParallelProjectionOn();
  renderer->GetActiveCamera()->SetPosition(0, 0, 5);
  renderer->GetActiveCamera()->SetFocalPoint(0, 0, 0);
  renderer->GetActiveCamera()->SetParallelScale(1.0);
  renderer->ResetCameraClippingRange();
  offscreen.window()->AddRenderer(renderer);
  offscreen.window()->Render();
  vtkNew<vtkUnsignedCharArray> pixels;
  offscreen.window()->GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, pixels);
  std::vector<unsigned char> rgba(pixels->GetPointer(0),
                                  pixels->GetPointer(0) + pixels->GetNumberOfValues());
  offscreen.window()->RemoveRenderer(renderer);
  return rgba;
}

TEST(OffscreenWindow, RendersATriangleWithoutADisplay) {
  ::unsetenv("DISPLAY");
  constexpr int kSize = 100;
  OffscreenWindow offscreen(kSize, kSize);
  EXPECT_EQ(offscreen.backend(), "egl-surfaceless");
  EXPECT_FALSE(offscreen.renderer().empty());
  testing::internal::CaptureStderr();
  const std::vector<unsigned char> rgba = render_triangle(offscreen, kSize, kSize);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  ASSERT_EQ(rgba.size(), 4u * kSize * kSize);
  const auto pixel = [&](int x, int y_up) {
    const unsigned char* p = &rgba[4 * (static_cast<std::size_t>(y_up) * kSize + x)];
    return std::array<int, 3>{p[0], p[1], p[2]};
  };
  const std::array<int, 3> green{0, 255, 0}, grey{51, 51, 51};
  EXPECT_EQ(pixel(10, 10), green);
  EXPECT_EQ(pixel(85, 10), green);
  EXPECT_EQ(pixel(10, 85), green);
  EXPECT_EQ(pixel(90, 90), grey);
  EXPECT_EQ(pixel(60, 60), grey);
}

TEST(OffscreenWindow, GivesTheSamePixelsInEveryWindowOfAProcess) {
  ::unsetenv("DISPLAY");
  std::vector<unsigned char> first;
  for (int i = 0; i < 3; ++i) {
    OffscreenWindow offscreen(64, 48);
    const std::vector<unsigned char> rgba = render_triangle(offscreen, 64, 48);
    if (i == 0) first = rgba;
    EXPECT_EQ(rgba, first) << "window " << i;
  }
}

TEST(OffscreenWindow, TwoWindowsMayLiveSideBySide) {
  ::unsetenv("DISPLAY");
  OffscreenWindow a(64, 64), b(32, 32);
  const std::vector<unsigned char> from_a = render_triangle(a, 64, 64);
  const std::vector<unsigned char> from_b = render_triangle(b, 32, 32);
  EXPECT_EQ(from_a.size(), 4u * 64 * 64);
  EXPECT_EQ(from_b.size(), 4u * 32 * 32);
  EXPECT_EQ(from_a, render_triangle(a, 64, 64));
}

TEST(OffscreenWindow, PrintsNothing) {
  ::unsetenv("DISPLAY");
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  { OffscreenWindow offscreen(16, 16); }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
}

TEST(OffscreenWindow, RefusesSizesThatAreNoPicture) {
  EXPECT_THROW(OffscreenWindow(0, 100), std::invalid_argument);
  EXPECT_THROW(OffscreenWindow(100, -1), std::invalid_argument);
  EXPECT_THROW(OffscreenWindow(100, 16385), std::invalid_argument);
}

TEST(OffscreenWindowDeathTest, SaysSoWhereNothingCanRender) {
  // A process of its own, in which the EGL loader finds no driver and no display is set.
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        ::unsetenv("DISPLAY");
        ::setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent.json", 1);
        ::setenv("PATH", "/nonexistent", 1);  // no Xvfb either
        try {
          OffscreenWindow offscreen(16, 16);
          std::exit(5);
        } catch (const MachineError& error) {
          std::fprintf(stderr, "%s\n", error.what());
          std::exit(error.exit_code());
        }
      },
      testing::ExitedWithCode(3),
      "no rendering back end: .*DISPLAY is not set, and Xvfb cannot be started");
}

TEST(OffscreenWindowDeathTest, FallsBackToADisplay) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  // The child process runs the lines before EXPECT_EXIT too; the parent's display is handed down.
  const char* inherited = std::getenv("CAMBER_TEST_DISPLAY");
  std::unique_ptr<test::VirtualDisplay> display;
  if (!inherited) {
    display = std::make_unique<test::VirtualDisplay>();
    if (display->number().empty()) GTEST_SKIP() << "no Xvfb on this machine";
    ::setenv("CAMBER_TEST_DISPLAY", (":" + display->number()).c_str(), 1);
  }
  EXPECT_EXIT(
      {
        ::setenv("DISPLAY", std::getenv("CAMBER_TEST_DISPLAY"), 1);
        ::setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent.json", 1);
        OffscreenWindow offscreen(100, 100);
        const std::vector<unsigned char> rgba = render_triangle(offscreen, 100, 100);
        const unsigned char* inside = &rgba[4 * (10 * 100 + 10)];
        const bool right = inside[0] == 0 && inside[1] == 255 && inside[2] == 0;
        std::fprintf(stderr, "%s by %s\n", offscreen.backend().c_str(),
                     offscreen.renderer().c_str());
        std::exit(right ? 0 : 6);
      },
      testing::ExitedWithCode(0), "display by .+");
  ::unsetenv("CAMBER_TEST_DISPLAY");
}

TEST(OffscreenWindowDeathTest, StartsAnXvfbOfItsOwnAtLast) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  if (std::system("command -v Xvfb >/dev/null 2>&1") != 0) GTEST_SKIP() << "no Xvfb here";
  EXPECT_EXIT(
      {
        ::unsetenv("DISPLAY");
        ::setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent.json", 1);
        bool right = true;
        std::string backend;
        for (int i = 0; i < 2; ++i) {  // the second window finds the first one's server
          OffscreenWindow offscreen(100, 100);
          const std::vector<unsigned char> rgba = render_triangle(offscreen, 100, 100);
          const unsigned char* inside = &rgba[4 * (10 * 100 + 10)];
          right = right && inside[0] == 0 && inside[1] == 255 && inside[2] == 0;
          backend += offscreen.backend() + " ";
        }
        std::fprintf(stderr, "%s\n", backend.c_str());
        std::_Exit(right ? 0 : 6);  // what the driver keeps, unloaded by now, is no leak of ours
      },
      testing::ExitedWithCode(0), "xvfb xvfb");
}

TEST(OffscreenWindowDeathTest, ADisplayThatDoesNotAnswerIsAnErrorNotAnAbort) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        ::setenv("DISPLAY", ":54321", 1);
        ::setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent.json", 1);
        ::setenv("PATH", "/nonexistent", 1);  // no Xvfb either
        try {
          OffscreenWindow offscreen(16, 16);
          std::exit(5);
        } catch (const MachineError& error) {
          std::fprintf(stderr, "%s\n", error.what());
          std::exit(error.exit_code());
        }
      },
      testing::ExitedWithCode(3), "the display \":54321\" does not answer");
}

}  // namespace
}  // namespace camber

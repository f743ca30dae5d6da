#include "camber/core/status.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <thread>

#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"

namespace camber {
namespace {

TEST(Status, WordsAreThoseOfTheResultFiles) {
  EXPECT_EQ(to_string(Status::kOk), "ok");
  EXPECT_EQ(to_string(Status::kWeak), "weak");
  EXPECT_EQ(to_string(Status::kNotObservable), "not_observable");
  EXPECT_EQ(to_string(Status::kFailed), "failed");
  EXPECT_EQ(to_string(Status::kNotRun), "not_run");
  for (const Status status :
       {Status::kNotRun, Status::kOk, Status::kWeak, Status::kNotObservable, Status::kFailed}) {
    EXPECT_EQ(status_from_string(to_string(status)), status);
  }
  EXPECT_THROW(status_from_string("OK"), std::invalid_argument);
  EXPECT_THROW(status_from_string(""), std::invalid_argument);
}

TEST(Errors, CarryTheExitCodesOfTheProgram) {
  EXPECT_EQ(NoAnswerError("x").exit_code(), 1);
  EXPECT_EQ(UsageError("x").exit_code(), 2);
  EXPECT_EQ(InputError("file", "line 3", "found a, expected b").exit_code(), 2);
  EXPECT_STREQ(InputError("file", "line 3", "found a, expected b").what(),
               "file: line 3: found a, expected b");
  EXPECT_STREQ(InputError("file", "cannot be opened").what(), "file: cannot be opened");
  EXPECT_EQ(OutputError("file", "x").exit_code(), 3);
  EXPECT_EQ(OutputError("file", "x").path(), "file");
  EXPECT_EQ(MachineError("x").exit_code(), 3);
  EXPECT_EQ(InterruptedError().exit_code(), 130);
}

TEST(StageTimer, AddsUpByStageInOrderOfAppearance) {
  Timings timings;
  timings.add("load", 1.5);
  {
    StageTimer timer(timings, "compute");
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    timer.stop();
    timer.stop();
  }
  { StageTimer timer(timings, "load"); }
  ASSERT_EQ(timings.stages().size(), 2u);
  EXPECT_EQ(timings.stages()[0].first, "load");
  EXPECT_GE(timings.stages()[0].second, 1.5);
  EXPECT_EQ(timings.stages()[1].first, "compute");
  EXPECT_GE(timings.stages()[1].second, 5.0);
}

}  // namespace
}  // namespace camber

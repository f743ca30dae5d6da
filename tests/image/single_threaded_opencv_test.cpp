#include "camber/image/detail/single_threaded_opencv.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

namespace camber {
namespace {

TEST(SingleThreadedOpenCv, HoldsForAllWhileAnyLivesAndSetsTheNumberBack) {
  const int before = cv::getNumThreads();
  cv::setNumThreads(2);
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 300; ++i) {
        const SingleThreadedOpenCv guard;
        if (cv::getNumThreads() != 1) ++wrong;
        std::this_thread::yield();
        if (cv::getNumThreads() != 1) ++wrong;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong.load(), 0);
  EXPECT_EQ(cv::getNumThreads(), 2);
  cv::setNumThreads(before);
}

TEST(SingleThreadedOpenCv, MayBeNested) {
  const int before = cv::getNumThreads();
  cv::setNumThreads(2);
  {
    const SingleThreadedOpenCv outer;
    { const SingleThreadedOpenCv inner; }
    EXPECT_EQ(cv::getNumThreads(), 1);
  }
  EXPECT_EQ(cv::getNumThreads(), 2);
  cv::setNumThreads(before);
}

}  // namespace
}  // namespace camber

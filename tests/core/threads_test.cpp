#include "camber/core/threads.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <numeric>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"

namespace camber {
namespace {

TEST(ResolveNumThreads, TakesTheRequestThenTheEnvironmentThenTheMachine) {
  ::setenv("OMP_NUM_THREADS", "3", 1);
  EXPECT_EQ(resolve_num_threads(5), 5);
  EXPECT_EQ(resolve_num_threads(0), 3);
  EXPECT_EQ(resolve_num_threads(-1), 3);
  for (const char* const useless : {"", "0", "-4", "many"}) {
    ::setenv("OMP_NUM_THREADS", useless, 1);
    EXPECT_GE(resolve_num_threads(0), 1) << useless;
  }
  ::unsetenv("OMP_NUM_THREADS");
  EXPECT_GE(resolve_num_threads(0), 1);
}

TEST(ResolveNumThreads, StaysWhereStacksHaveMemory) {
  const int most = resolve_num_threads(2000000000);
  EXPECT_GE(most, 64);
  EXPECT_LE(most, std::max(64u, 4 * std::thread::hardware_concurrency()));
  ::setenv("OMP_NUM_THREADS", "1000000", 1);
  EXPECT_EQ(resolve_num_threads(0), most);
  ::unsetenv("OMP_NUM_THREADS");
  std::atomic<int> calls{0};
  parallel_for(100000, 2000000000, [&](std::size_t) { ++calls; });
  EXPECT_EQ(calls.load(), 100000);
}

TEST(ParallelFor, CallsEveryIndexOnce) {
  for (const int threads : {1, 2, 8}) {
    for (const std::size_t count : {0u, 1u, 2u, 1000u}) {
      std::vector<std::atomic<int>> calls(count);
      parallel_for(count, threads, [&](std::size_t i) { ++calls[i]; });
      for (const std::atomic<int>& c : calls) EXPECT_EQ(c.load(), 1);
    }
  }
}

TEST(ParallelFor, RethrowsWhatABodyThrows) {
  for (const int threads : {1, 4}) {
    EXPECT_THROW(parallel_for(100, threads,
                              [](std::size_t i) {
                                if (i == 57) throw std::runtime_error("body");
                              }),
                 std::runtime_error);
  }
}

TEST(ParallelFor, RethrowsWhatTheLowestIndexThrows) {
  for (const int threads : {1, 2, 8}) {
    for (int attempt = 0; attempt < 5; ++attempt) {
      try {
        parallel_for(100, threads, [](std::size_t i) {
          // Others have thrown long before.
          if (i == 3) std::this_thread::sleep_for(std::chrono::milliseconds(5));
          if (i >= 3) throw std::runtime_error(std::to_string(i));
        });
        ADD_FAILURE() << "nothing was thrown";
      } catch (const std::runtime_error& error) {
        EXPECT_STREQ(error.what(), "3") << threads;
      }
    }
  }
}

TEST(ParallelFor, SumsInIndexOrderAreTheSameForAnyThreads) {
  const auto total = [](int threads) {
    std::vector<double> parts(10000);
    parallel_for(parts.size(), threads,
                 [&](std::size_t i) { parts[i] = 1.0 / (1.0 + static_cast<double>(i)); });
    return std::accumulate(parts.begin(), parts.end(), 0.0);
  };
  EXPECT_EQ(total(1), total(8));
}

TEST(ParallelFor, StopsOnceItIsAskedTo) {
  // In a process of its own: there is no way back.
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  for (const int threads : {1, 4}) {
    EXPECT_EXIT(
        {
          std::atomic<int> calls{0};
          try {
            parallel_for(1'000'000, threads, [&](std::size_t) {
              if (++calls == 10) request_interruption();
              std::this_thread::sleep_for(std::chrono::microseconds(100));
            });
          } catch (const InterruptedError&) {
            std::_Exit(calls < 1000 ? 130 : 1);
          }
        },
        ::testing::ExitedWithCode(130), "");
  }
}

TEST(ParallelFor, MayBeNested) {
  std::atomic<int> calls{0};
  parallel_for(8, 4, [&](std::size_t) { parallel_for(8, 4, [&](std::size_t) { ++calls; }); });
  EXPECT_EQ(calls.load(), 64);
}

}  // namespace
}  // namespace camber

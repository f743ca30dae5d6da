#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <limits>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

#include "camber/core/detail/side_by_side.h"

namespace camber::detail {
namespace {

void wait_a_moment() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#else
  std::this_thread::yield();
#endif
}

/// One call of run_side_by_side: its indices are taken in small runs by the caller and its helpers.
class Call {
 public:
  Call(std::size_t count, int threads, const std::function<void(std::size_t)>& body)
      : count_(count), threads_(static_cast<std::size_t>(threads)), body_(body) {}

  void work() {
    std::size_t begin = 0, end = 0;
    while (take(&begin, &end)) {
      std::size_t i = begin;
      try {
        for (; i < end && i < failed_.load(std::memory_order_relaxed); ++i) body_(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (i < failed_.load(std::memory_order_relaxed)) {
          first_ = std::current_exception();
          failed_.store(i, std::memory_order_relaxed);
        }
      }
    }
  }

  bool is_open() const { return next_.load(std::memory_order_relaxed) < count_; }
  void rethrow() const {
    if (first_) std::rethrow_exception(first_);
  }

  // Written under the crew's lock.
  std::size_t places = 0;  ///< for helpers that may still come
  std::atomic<std::size_t> helpers{0};

 private:
  /// A run of indices that shrinks with what is left, so that all end at about the same time.
  bool take(std::size_t* begin, std::size_t* end) {
    std::size_t at = next_.load(std::memory_order_relaxed), step = 0;
    do {
      if (at >= std::min(count_, failed_.load(std::memory_order_relaxed))) return false;
      step = std::max<std::size_t>(1, (count_ - at) / (8 * threads_));
    } while (!next_.compare_exchange_weak(at, at + step, std::memory_order_relaxed));
    *begin = at;
    *end = at + step;
    return true;
  }

  std::atomic<std::size_t> next_{0};
  std::size_t count_, threads_;
  const std::function<void(std::size_t)>& body_;
  /// Lowest index whose body has thrown. Runs are taken in order: all below it will be called.
  std::atomic<std::size_t> failed_{std::numeric_limits<std::size_t>::max()};
  std::mutex mutex_;
  std::exception_ptr first_;
};

/// Threads that wait for calls to help with. As many as were asked for so far; they sleep until the
/// process ends.
class Crew {
 public:
  /// Never destroyed: its threads may be at work while the process ends.
  static Crew& instance() {
    static Crew* const crew = new Crew;
    return *crew;
  }

  void run(std::size_t count, int threads, const std::function<void(std::size_t)>& body) {
    Call call(count, threads, body);
    const std::size_t most = std::min(count, static_cast<std::size_t>(threads)) - 1;
    call.places = most;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      while (members_ < most && hire()) ++members_;
      open_.push_back(&call);
      opened_.fetch_add(1, std::memory_order_relaxed);
    }
    if (most == 1) {
      work_.notify_one();
    } else {
      work_.notify_all();
    }
    call.work();
    {
      std::unique_lock<std::mutex> lock(mutex_);
      open_.erase(std::find(open_.begin(), open_.end(), &call));
      if (call.helpers.load(std::memory_order_relaxed) > 0) {
        // Most end at once; it takes longer to be woken.
        lock.unlock();
        for (int i = 0; i < kMoments && call.helpers.load(std::memory_order_acquire) > 0; ++i) {
          wait_a_moment();
        }
        lock.lock();
        left_.wait(lock, [&] { return call.helpers.load(std::memory_order_relaxed) == 0; });
      }
    }
    call.rethrow();
  }

 private:
  static constexpr int kMoments = 1000;  // some ten microseconds

  /// False where the machine has no more threads: those that there are do the work.
  bool hire() {
    try {
      std::thread([this] { help(); }).detach();
      return true;
    } catch (const std::system_error&) {
      return false;
    }
  }

  /// The latest call that has a place: it may be what an older one waits for.
  Call* find_call() const {
    for (auto call = open_.rbegin(); call != open_.rend(); ++call) {
      if ((*call)->places > 0 && (*call)->is_open()) return *call;
    }
    return nullptr;
  }

  void help() {
    std::unique_lock<std::mutex> lock(mutex_);
    for (;;) {
      Call* call = find_call();
      if (call == nullptr) {
        const unsigned opened = opened_.load(std::memory_order_relaxed);
        lock.unlock();
        for (int i = 0; i < kMoments && opened_.load(std::memory_order_relaxed) == opened; ++i) {
          wait_a_moment();
        }
        lock.lock();
        work_.wait(lock, [&] { return (call = find_call()) != nullptr; });
      }
      --call->places;
      call->helpers.fetch_add(1, std::memory_order_relaxed);
      lock.unlock();
      call->work();
      lock.lock();
      if (call->helpers.fetch_sub(1, std::memory_order_release) == 1) left_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable work_, left_;
  std::vector<Call*> open_;
  std::atomic<unsigned> opened_{0};
  std::size_t members_ = 0;
};

}  // namespace

void run_side_by_side(std::size_t count, int threads,
                      const std::function<void(std::size_t)>& body) {
  Crew::instance().run(count, threads, body);
}

}  // namespace camber::detail

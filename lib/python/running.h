#pragma once

#include <pybind11/pybind11.h>

#include <csignal>
#include <functional>
#include <memory>
#include <optional>

#include "camber/core/progress.h"

namespace camber::python {

namespace py = pybind11;

/// While it lives the interpreter's lock is released and, in the main thread, SIGINT stops what
/// computes; Python's own handler then raises KeyboardInterrupt.
class Computation {
 public:
  Computation();
  ~Computation();
  Computation(const Computation&) = delete;
  Computation& operator=(const Computation&) = delete;

 private:
  bool handling_ = false;
  struct sigaction before_ {};
  std::optional<py::gil_scoped_release> released_;
};

/// Runs a computation that takes a while. @throws what it throws; py::error_already_set
/// (KeyboardInterrupt) if it was interrupted.
template <typename Function>
auto compute(Function&& function) {
  const Computation running;
  return function();
}

/// Warnings of the library as Python's UserWarning. Takes the interpreter's lock.
LogSink python_warnings();

/// What the library decides on the way: to the logger "camber", level INFO. Takes the interpreter's
/// lock.
LogSink python_log();

/// A Python function (stage, share), or None, as the library calls it.
Progress to_progress(const py::object& callback);

}  // namespace camber::python

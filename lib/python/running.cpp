#include "running.h"

#include <cerrno>
#include <string>

#include "camber/core/interruption.h"

namespace camber::python {
namespace {

struct sigaction g_before {};  // of the one Computation that handles SIGINT

void on_interrupt(int signal, siginfo_t* info, void* context) {
  const int error = errno;
  request_interruption();
  if ((g_before.sa_flags & SA_SIGINFO) != 0) {
    g_before.sa_sigaction(signal, info, context);
  } else if (g_before.sa_handler != SIG_DFL && g_before.sa_handler != SIG_IGN) {
    g_before.sa_handler(signal);
  }
  errno = error;
}

bool in_main_thread() {
  const py::module_ threading = py::module_::import("threading");
  return threading.attr("current_thread")().is(threading.attr("main_thread")());
}

}  // namespace

Computation::Computation() {
  if (in_main_thread() && sigaction(SIGINT, nullptr, &before_) == 0) {
    const bool python_handles = (before_.sa_flags & SA_SIGINFO) != 0 ||
                                (before_.sa_handler != SIG_DFL && before_.sa_handler != SIG_IGN);
    // Nested (a callback that computes): the outer one handles it.
    const bool ours = (before_.sa_flags & SA_SIGINFO) != 0 && before_.sa_sigaction == on_interrupt;
    if (python_handles && !ours) {
      g_before = before_;
      struct sigaction action {};
      action.sa_sigaction = on_interrupt;
      action.sa_flags = SA_SIGINFO | (before_.sa_flags & SA_ONSTACK);
      handling_ = sigaction(SIGINT, &action, nullptr) == 0;
    }
  }
  released_.emplace();
}

Computation::~Computation() {
  released_.reset();
  if (!handling_) return;
  sigaction(SIGINT, &before_, nullptr);
  reset_interruption();
}

LogSink python_warnings() {
  return [](const std::string& sentence) {
    const py::gil_scoped_acquire lock;
    if (PyErr_WarnEx(PyExc_UserWarning, sentence.c_str(), 1) != 0) throw py::error_already_set();
  };
}

LogSink python_log() {
  return [](const std::string& sentence) {
    const py::gil_scoped_acquire lock;
    py::module_::import("logging").attr("getLogger")("camber").attr("info")("%s", sentence);
  };
}

Progress to_progress(const py::object& callback) {
  if (callback.is_none()) return {};
  // Copied and freed by C++ code that runs without the interpreter's lock.
  const std::shared_ptr<py::object> held(new py::object(callback), [](py::object* object) {
    const py::gil_scoped_acquire lock;
    delete object;
  });
  return [held](const std::string& stage, double share) {
    const py::gil_scoped_acquire lock;
    (*held)(stage, share);
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  };
}

}  // namespace camber::python

#include <string>

#include "camber/core/errors.h"
#include "convert.h"

namespace camber::python {
namespace {

// Classes of the module, held for good: exceptions may be translated while the interpreter ends.
PyObject* g_error = nullptr;
PyObject* g_no_answer = nullptr;
PyObject* g_input = nullptr;
PyObject* g_output = nullptr;
PyObject* g_usage = nullptr;
PyObject* g_machine = nullptr;

PyObject* make_class(py::module_& module, const char* name, const py::tuple& bases,
                     const char* doc) {
  const std::string full = std::string("camber.") + name;
  PyObject* made = PyErr_NewExceptionWithDoc(full.c_str(), doc, bases.ptr(), nullptr);
  if (!made) throw py::error_already_set();
  module.add_object(name, py::reinterpret_borrow<py::object>(made));
  return made;
}

/// An instance with the exit code that the program has for it.
void raise(PyObject* type, const Error& error) {
  const py::object instance = py::reinterpret_borrow<py::object>(type)(error.what());
  instance.attr("exit_code") = error.exit_code();
  PyErr_SetObject(type, instance.ptr());
}

void translate(std::exception_ptr thrown) {
  try {
    if (thrown) std::rethrow_exception(thrown);
  } catch (const InterruptedError&) {
    // Python's own handler saw the signal, too, and raises its exception now.
    if (PyErr_CheckSignals() == 0) PyErr_SetNone(PyExc_KeyboardInterrupt);
  } catch (const NoAnswerError& error) {
    raise(g_no_answer, error);
  } catch (const InputError& error) {
    raise(g_input, error);
  } catch (const OutputError& error) {
    raise(g_output, error);
  } catch (const UsageError& error) {
    raise(g_usage, error);
  } catch (const MachineError& error) {
    raise(g_machine, error);
  } catch (const Error& error) {
    raise(g_error, error);
  }
}

}  // namespace

void bind_errors(py::module_& module) {
  const auto class_of = [](PyObject* type) { return py::reinterpret_borrow<py::object>(type); };
  g_error = make_class(module, "Error", py::make_tuple(class_of(PyExc_Exception)),
                       "Base of Camber's errors; exit_code is the program's for it.");
  const py::object base = class_of(g_error);
  const auto derived = [&](const char* name, PyObject* standard, const char* doc) {
    return make_class(module, name, py::make_tuple(base, class_of(standard)), doc);
  };
  g_no_answer = derived("NoAnswerError", PyExc_RuntimeError, kDoc_NoAnswerError);
  g_input = derived("InputError", PyExc_ValueError, kDoc_InputError);
  g_output = derived("OutputError", PyExc_OSError, kDoc_OutputError);
  g_usage = derived("UsageError", PyExc_ValueError, kDoc_UsageError);
  g_machine = derived("MachineError", PyExc_RuntimeError, kDoc_MachineError);
  py::register_exception_translator(translate);
}

}  // namespace camber::python

// Defines the module raylift._core, and translates C++ exceptions.

#include <cstdio>
#include <regex>

#include "apps/interrupt.h"
#include "apps/mesh_trial.h"
#include "apps/program.h"
#include "apps/python/conversions.h"

namespace raylift::python {
namespace {

// Returns the message with keywords in place of options: "--min-iterations = 0: ..." becomes
// "min_iterations = 0: ...".
std::string MessageInKeywords(const OptionError& error) {
  const std::string message = MessageInOptions(error);
  static const std::regex kOption("(^|[^-\\w])--([a-z][-a-z0-9]*)");
  std::string text;
  auto rest = message.cbegin();
  for (std::smatch match; std::regex_search(rest, message.cend(), match, kOption);
       rest = match[0].second) {
    std::string keyword = match[2];
    std::replace(keyword.begin(), keyword.end(), '-', '_');
    text += match.prefix().str() + match[1].str() + keyword;
  }
  return text + std::string(rest, message.cend());
}

// These live as long as the interpreter.
PyObject* wrong_type = nullptr;

void TranslateExceptions(py::module_& module) {
  static PyObject* const input_error =
      py::exception<InputError>(module, "InputError", PyExc_ValueError).release().ptr();
  static PyObject* const option_error =
      py::exception<OptionError>(module, "OptionError", PyExc_ValueError).release().ptr();
  const py::object both = py::make_tuple(py::handle(input_error), py::handle(PyExc_TypeError));
  wrong_type = py::exception<WrongType>(module, "InputTypeError", both).release().ptr();
  py::setattr(
      input_error, "__doc__",
      py::str("Bad input: a file, or an argument's value. One line that names it, the place\n"
              "in it, what was expected and what was found."));
  py::setattr(wrong_type, "__doc__",
              py::str("An argument of a wrong type, which is a TypeError, too."));
  py::setattr(option_error, "__doc__", py::str("A bad option: \"name = value: constraint\"."));
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const WrongType& error) {
      PyErr_SetString(wrong_type, error.what());
    } catch (const InputError& error) {
      PyErr_SetString(input_error, error.what());
    } catch (const OptionError& error) {
      PyErr_SetString(option_error, MessageInKeywords(error).c_str());
    } catch (const py::cast_error&) {
      PyErr_SetString(wrong_type, "an argument, or what it holds, is of a wrong type");
    } catch (const Interrupted& error) {
      PyErr_SetString(PyExc_KeyboardInterrupt, error.what());
    } catch (const std::filesystem::filesystem_error& error) {
      PyErr_SetString(input_error, error.what());
    }
  });
}

// The arguments of a call.
struct Given {
  py::list arguments;
  py::dict keywords;
};
Given ToGiven(PyObject* arguments, PyObject* keywords) {
  Given given{py::list(py::reinterpret_borrow<py::object>(arguments)), {}};
  if (keywords != nullptr) given.keywords = py::reinterpret_borrow<py::dict>(keywords);
  return given;
}
// Takes arguments as newer versions of Python pass them: the values of the keywords behind the
// others.
Given ToGiven(PyObject* const* values, size_t flagged_count, PyObject* names) {
  Given given;
  auto next = static_cast<size_t>(PyVectorcall_NARGS(flagged_count));
  for (size_t i = 0; i < next; ++i) given.arguments.append(py::handle(values[i]));
  if (names == nullptr) return given;
  for (const py::handle name : py::handle(names)) {
    given.keywords[name] = py::handle(values[next++]);
  }
  return given;
}

// Reports arguments that fit no signature by raylift._arguments, in one line. Python's functions
// are called while no error is set.
template <typename... Arguments>
void MendTypeError(Arguments... arguments) {
  py::error_already_set raised;
  try {
    const std::string message = py::str(raised.value());
    if (message.find("(): incompatible ") == std::string::npos) return raised.restore();
    const Given given = ToGiven(arguments...);
    const py::object explain = py::module_::import("raylift._arguments").attr("explain");
    const auto line =
        explain(message, given.arguments, given.keywords).template cast<std::string>();
    PyErr_SetString(wrong_type, line.c_str());
  } catch (const std::exception&) {
    raised.restore();
  }
}

// Wraps the one entry that pybind11's functions have in common.
template <typename... Arguments>
struct Mended {
  using Entry = PyObject* (*)(PyObject*, Arguments...);
  static inline Entry entry = nullptr;

  static PyObject* Call(PyObject* self, Arguments... arguments) {
    PyObject* const result = entry(self, arguments...);
    if (result == nullptr && PyErr_ExceptionMatches(PyExc_TypeError) != 0)
      MendTypeError(arguments...);
    return result;
  }
  static void Wrap(PyMethodDef& method) {
    const auto found = reinterpret_cast<Entry>(reinterpret_cast<void (*)()>(method.ml_meth));
    if (found == &Call) return;
    entry = found;
    method.ml_meth = reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(&Call));
  }
};

void WrapFunction(py::handle function) {
  if (PyInstanceMethod_Check(function.ptr()) != 0) {
    function = PyInstanceMethod_GET_FUNCTION(function.ptr());
  }
  if (PyCFunction_Check(function.ptr()) == 0) return;
  PyMethodDef& method = *reinterpret_cast<PyCFunctionObject*>(function.ptr())->m_ml;
  if (method.ml_flags == (METH_VARARGS | METH_KEYWORDS)) {
    Mended<PyObject*, PyObject*>::Wrap(method);
  } else if (method.ml_flags == (METH_FASTCALL | METH_KEYWORDS)) {
    Mended<PyObject* const*, size_t, PyObject*>::Wrap(method);
  }
}

// Wraps all functions of a module, and the methods of its classes.
void WrapFunctions(const py::handle& owner) {
  const py::object members = py::module_::import("builtins").attr("vars")(owner);
  for (const py::handle pair : py::list(members.attr("items")())) {
    const py::object member = py::reinterpret_borrow<py::tuple>(pair)[1];
    if (PyType_Check(member.ptr()) != 0 &&
        py::object(member.attr("__module__")).equal(py::str("raylift._core"))) {
      WrapFunctions(member);
    } else {
      WrapFunction(py::getattr(member, "__func__", member));
    }
  }
}

// Refuses numpy 2 with pybind11 before 2.12, which takes its arrays for those of numpy 1, and all
// their rows for the first.
void RefuseNumpyThatIsNotKnown() {
#if PYBIND11_VERSION_HEX < 0x020C0000
  const auto version = py::module_::import("numpy").attr("__version__").cast<std::string>();
  if (version.rfind("1.", 0) == 0) return;
  throw py::import_error(fmt::format(
      "raylift was built with pybind11 {}.{}, which knows numpy 1 alone; found numpy {}. "
      "`pip install .` builds it with a newer one",
      PYBIND11_VERSION_MAJOR, PYBIND11_VERSION_MINOR, version));
#endif
}

// Flushes what is printed when a command ends, however it does: Python knows nothing of this
// buffer.
struct FlushesOutput {
  ~FlushesOutput() { std::fflush(stdout); }
};

void BindProgram(py::module_& module) {
  const auto python = py::module_::import("sys").attr("executable").cast<std::string>();
  TryMeshesBy({python, "-c",
               "import sys; from raylift import _core; _core.run_program(sys.argv[1:])", kTryMesh});
  module.def(
      "run_command",
      [](const std::vector<std::string>& arguments, const std::optional<ProgressCall>& progress) {
        const FlushesOutput flushes;
        WithoutLock(progress, [&] { RunCommand(arguments); });
      },
      py::arg("arguments"), py::kw_only(), py::arg("progress") = py::none(),
      "Runs a command of the program by its arguments, as a shell would.\n\n"
      "Raises OptionError and InputError where the program would end with such a message.");
  module.def(
      "run_program",
      [](const std::vector<std::string>& arguments) {
        return WithoutLock([&] { return RunProgram(arguments); });
      },
      py::arg("arguments"), "The program `raylift`. Returns its exit code.");
  module.def("kinds_of_options", &KindsOfCommands,
             "What each option of each command takes; make_options.py makes _options.py of it.");
}

}  // namespace
}  // namespace raylift::python

PYBIND11_MODULE(_core, module) {
  using namespace raylift::python;
  RefuseNumpyThatIsNotKnown();
  module.doc() = "The compiled part of raylift.";
  module.attr("VERSION") = RAYLIFT_VERSION;
  module.attr("PYBIND11_MAJOR") = PYBIND11_VERSION_MAJOR;
  TranslateExceptions(module);
  BindGeometry(module);
  BindEstimation(module);
  BindMesh(module);
  BindRendering(module);
  BindLifting(module);
  BindScene(module);
  BindLocalization(module);
  BindTracking(module);
  BindIo(module);
  BindProgram(module);
  WrapFunctions(module);
}

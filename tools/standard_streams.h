#pragma once

#include <exception>
#include <string>

namespace camber::tools {

/// Where the program was started with standard input, output or error closed, opens them so that no
/// file gets their numbers: reading finds the end, writing fails. A closed pipe or a file that
/// reaches its largest size is then an error of the write, no signal.
void open_standard_streams();

/// Whether all that was printed has been taken: a result on a full disk is none.
/// @return `exit_code`; 3 in place of 0, after a sentence on stderr, if something is lost.
int finish_standard_output(int exit_code);

/// Whether an exception, ours or a library's, means that memory or threads cannot be had.
bool is_out_of_memory(const std::exception& error);

/// A text in one line: control characters, as file names and options may have them, as '?'.
std::string one_line(std::string text);

/// Prints what happened, one line whatever the exception holds. Allocates nothing.
/// @return the exit code: an Error's own; 2 for what a caller did wrong, else 3.
int report_failure(const std::exception& error);

}  // namespace camber::tools

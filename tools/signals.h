#pragma once

namespace camber::tools {

/// From now on the first signal to stop (SIGINT, SIGTERM, SIGHUP) asks the library to stop
/// (core/interruption.h). Where that takes longer than 0.7 s, or a second signal comes, a thread
/// that waits for it removes what is half-written and ends the program with 130. The third ends it
/// at once.
void watch_signals();

/// What cannot be caught where it is thrown: from now on an exception that leaves a thread ends the
/// program with 3 and a sentence, and so does, under a limit of memory (ulimit -v, -d), a library
/// that breaks down for want of it; what is half-written is removed.
void watch_failures();

/// For the end of a command: whether it reports that it was interrupted. Does not return where the
/// waiting thread is about to end the program.
bool ends_interrupted();

}  // namespace camber::tools

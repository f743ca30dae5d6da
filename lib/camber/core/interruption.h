#pragma once

namespace camber {

/// Asks what computes in this process to stop: parallel_for and throw_if_interrupted() throw
/// InterruptedError from now on. Safe to call from a signal handler.
void request_interruption() noexcept;
bool interruption_requested() noexcept;
/// Takes the request back, for a process that goes on: once nothing that it was to stop runs.
void reset_interruption() noexcept;

/// For long loops. @throws InterruptedError once request_interruption() was called.
void throw_if_interrupted();

}  // namespace camber

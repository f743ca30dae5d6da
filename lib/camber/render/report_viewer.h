#pragma once

namespace camber {

/// The script of a report's 3D view: reads the glTF binary that is embedded in the page and draws
/// it with WebGL 2. Where the browser has none the page stays as it is.
extern const char* const kReportViewer;

/// The script by which figures answer to pointing: an area of class "hit" writes its title below.
extern const char* const kReportAnswers;

}  // namespace camber

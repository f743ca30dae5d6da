# camber_add_module(NAME SOURCES ... [PUBLIC targets...] [PRIVATE targets...])
# One folder of lib/camber is one static library camber_NAME with the alias camber::NAME. A folder
# within it that needs more than the rest may be a library of its own, camber_NAME_FOLDER.
function(camber_add_module name)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  add_library(camber_${name} STATIC ${ARG_SOURCES})
  add_library(camber::${name} ALIAS camber_${name})
  set_target_properties(camber_${name} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(camber_${name} PUBLIC cxx_std_17)
  target_include_directories(
    camber_${name} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/lib>
                          $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(camber_${name} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
  set_property(GLOBAL APPEND PROPERTY CAMBER_MODULES camber_${name})
endfunction()

# camber_add_test(MODULE SOURCES ... [LIBRARIES targets...] [LABELS ...])
# One GoogleTest program a module, test_MODULE; every case becomes a ctest with the label (unit).
function(camber_add_test module)
  cmake_parse_arguments(ARG "" "" "SOURCES;LIBRARIES;LABELS" ${ARGN})
  add_executable(test_${module} ${ARG_SOURCES})
  target_link_libraries(test_${module} PRIVATE camber_test_support ${ARG_LIBRARIES})
  if(NOT ARG_LABELS)
    set(ARG_LABELS unit)
  endif()
  gtest_discover_tests(test_${module} DISCOVERY_TIMEOUT 120
                       TEST_PREFIX "${module}." PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT 900)
endfunction()

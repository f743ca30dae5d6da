# cmake -DRULES=... -DVIEWER=... -DWORK=... -P no_viewer_test.cmake
# Follows the viewers' install rules as if the viewer had not been built.
file(READ ${RULES} rules)
string(REPLACE "${VIEWER}" "${VIEWER}-not-built" changed "${rules}")
if(changed STREQUAL rules)
  message(FATAL_ERROR "${RULES} does not install ${VIEWER}")
endif()
file(REMOVE_RECURSE ${WORK})
file(WRITE ${WORK}/rules.cmake "${changed}")
execute_process(COMMAND ${CMAKE_COMMAND} -DCMAKE_INSTALL_PREFIX=${WORK}/prefix -P ${WORK}/rules.cmake
                RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE out)
if(NOT status EQUAL 0)
  message(FATAL_ERROR "installing without the viewer ended with ${status}:\n${out}")
endif()
file(REMOVE_RECURSE ${WORK})

# The pages of web/ as a source file of the program.

# palpate_page(MODULE): adds the definitions of src/pages/internal/pages.h to a module: the pages, made by
# web/make_page.mjs, or none (no_page.cpp beside the caller) where they are not wanted or cannot be made.
function(palpate_page module)
  if(PALPATE_PAGE)
    # Those of scripts/setup.sh, if it had to install some.
    find_program(PALPATE_NODE NAMES node nodejs HINTS "${PROJECT_SOURCE_DIR}/build/node/bin")
    find_program(PALPATE_NPM npm HINTS "${PROJECT_SOURCE_DIR}/build/node/bin")
    set(version "")
    if(PALPATE_NODE)
      execute_process(COMMAND "${PALPATE_NODE}" --version OUTPUT_VARIABLE version ERROR_QUIET
                      OUTPUT_STRIP_TRAILING_WHITESPACE)
      string(REGEX REPLACE "^v" "" version "${version}")
    endif()
    if(PALPATE_NPM AND version VERSION_GREATER_EQUAL 18)
      file(GLOB_RECURSE sources CONFIGURE_DEPENDS "${PROJECT_SOURCE_DIR}/web/src/*"
           "${PROJECT_SOURCE_DIR}/web/public/*")
      foreach(name index.html report_template.html package.json package-lock.json tsconfig.json vite.config.ts make_page.mjs)
        list(APPEND sources "${PROJECT_SOURCE_DIR}/web/${name}")
      endforeach()
      set(page "${CMAKE_CURRENT_BINARY_DIR}/page_files.cpp")
      add_custom_command(
        OUTPUT "${page}" DEPENDS ${sources} VERBATIM COMMENT "Building the pages of viewer and reports"
        COMMAND "${PALPATE_NODE}" "${PROJECT_SOURCE_DIR}/web/make_page.mjs" "${CMAKE_CURRENT_BINARY_DIR}" "${PALPATE_NPM}")
      target_sources(palpate_${module} PRIVATE "${page}")
      if(PALPATE_TESTS)
        add_test(NAME page_types COMMAND "${PALPATE_NODE}" "${PROJECT_SOURCE_DIR}/web/check_types.mjs")
        set_tests_properties(page_types PROPERTIES SKIP_RETURN_CODE 77)
      endif()
      return()
    endif()
    message(STATUS "The pages of viewer and reports are left out: they need node 18 or newer and npm "
                   "(node: ${PALPATE_NODE} ${version}, npm: ${PALPATE_NPM}); 'make setup' installs them")
  endif()
  target_sources(palpate_${module} PRIVATE no_page.cpp)
endfunction()

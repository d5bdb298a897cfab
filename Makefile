# `make demo` and `make test` need nothing but Python 3.11 or later, make and a shell.
#
#     PYTHON=...  the Python that a missing virtual environment is made with; default the newest usable
#     VENV=...    where it is; default .venv
#     ARGS=...    more arguments for pytest or the benchmarks, such as ARGS="-k clearance -n 0"

VENV = .venv
PYTHON =
ARGS =

.DEFAULT_GOAL = help
.PHONY: help demo test test-slow test-all benchmark lint format clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-10s %s\n", $$1, $$2}' Makefile

demo: $(VENV)/.installed-video ## simulate trajectory 4: out, dwell, back
	@sh tools/system_libraries.sh "$(VENV)/bin/python"
	"$(VENV)/bin/pips" simulate trajectory_4 --out out/trajectory_4 --force
	@echo "Look at out/trajectory_4: summary.html and replay.html in a browser, summary.json, figures/."

test: $(VENV)/.installed-dev ## run the fast tests
	@sh tools/system_libraries.sh "$(VENV)/bin/python"
	"$(VENV)/bin/python" -m pytest $(ARGS)

test-slow: $(VENV)/.installed-all ## run the slow tests
	@sh tools/system_libraries.sh "$(VENV)/bin/python"
	"$(VENV)/bin/python" -m pytest -m slow $(ARGS)

test-all: $(VENV)/.installed-all ## run all tests
	@sh tools/system_libraries.sh "$(VENV)/bin/python"
	"$(VENV)/bin/python" -m pytest -m "slow or not slow" $(ARGS)

benchmark: $(VENV)/.installed-all ## measure our speed beside others; renews docs/benchmarks.md
	"$(VENV)/bin/python" -m benchmarks --markdown docs/benchmarks.md \
	    --figure docs/images/benchmarks.png $(ARGS)

lint: $(VENV)/.installed-dev ## check style, types and layers
	@failed=0; \
	for tool in "ruff check ." "ruff format --check ." mypy lint-imports; do \
	    echo "$$tool"; "$(VENV)/bin/"$$tool || failed=1; \
	done; exit $$failed

format: $(VENV)/.installed-dev ## put the code into its standard format
	"$(VENV)/bin/ruff" check --fix-only .
	"$(VENV)/bin/ruff" format .

clean: ## remove what runs, tests and builds leave, the virtual environment excepted
	rm -rf out build dist .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . -name '.venv*' -prune -o -name __pycache__ -type d -exec rm -rf {} +

$(VENV)/.installed-%: pyproject.toml
	@sh tools/setup_venv.sh "$(VENV)" "$*" "$(PYTHON)"

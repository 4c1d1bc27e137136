# Sourced by scripts that make and use wheels.

# Those that a wheel is given out for.
PYTHON_VERSIONS="3.10 3.11 3.12 3.13"

# home_of_python VERSION: pyenv's folder of it; nothing where there is none.
home_of_python() {
  local home
  for home in "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$1".*; do
    if [ -x "$home/bin/python$1" ]; then echo "$home"; return; fi
  done
}

# find_python VERSION: its program, on the path or pyenv's; nothing where there is none.
find_python() {
  local home
  if "python$1" -c "" 2> /dev/null; then
    echo "python$1"
  else
    home=$(home_of_python "$1")
    echo "${home:+$home/bin/python$1}"
  fi
}

# Shared by scripts/demo and scripts/test: takes a bare machine to a working .venv. Sourced, never run.
# Everything it does is checked first, so that a second run does next to nothing.

PYTHON=.venv/bin/python
unset PYTHONPATH PYTHONHOME
unset PYTHONDONTWRITEBYTECODE # hundreds of processes start: each would compile the package anew

say() { printf '==> %s\n' "$*"; }

stop() {
    printf 'error: %s\n' "$1" >&2
    shift
    for line in "$@"; do printf '       %s\n' "$line" >&2; done
    exit 2
}

# --- system packages ---

# Runs a command as root: directly, or by sudo (which may ask on a terminal, and must not where there is none).
as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"
    elif ! command -v sudo >/dev/null; then return 1
    elif [ -t 0 ]; then sudo "$@"
    else sudo -n "$@"
    fi
}

apt_listed=0
apt_update() {
    [ $apt_listed = 1 ] && return
    apt_listed=1
    say "reading the system's package lists"
    as_root env DEBIAN_FRONTEND=noninteractive apt-get update -q >"$log" 2>&1 || tail -n 5 "$log" >&2
}

# Installs system packages, or stops and says what to install by hand: install_system PURPOSE PACKAGE…
install_system() {
    local purpose=$1; shift
    command -v apt-get >/dev/null || stop "$purpose is missing, and this script installs with apt-get alone" \
        "Fedora:   dnf install python3 llvm-libs libatomic chromium nodejs-npm" \
        "Homebrew: brew install python@3.12 llvm node" "Then run this script again."
    [ "$(id -u)" = 0 ] || command -v sudo >/dev/null || stop "$purpose is missing, and installing it needs root or sudo" \
        "As root: apt-get install $*" "Then run this script again."
    apt_update
    say "installing $* ($purpose)"
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "$@" >"$log" 2>&1 && return
    tail -n 5 "$log" >&2
    stop "apt-get could not install $*" "As root: apt-get update && apt-get install $*" "Then run this script again."
}

# The newest libllvm that the system offers, tried ones first.
llvm_package() {
    local offered version
    offered=$(apt-cache pkgnames libllvm)
    for version in 19 22 18 17 21 20; do
        for name in "libllvm$version" "libllvm${version}t64"; do
            grep -qx "$name" <<<"$offered" && { echo "$name"; return; }
        done
    done
    return 1
}

need_llvm() {
    local check package
    # The package's own search decides; it needs nothing but its own plain modules and NumPy.
    check="from mirelight.base.backend import choose; raise SystemExit(choose() is None)"
    "$PYTHON" -c "$check" && return
    command -v apt-get >/dev/null || install_system "libLLVM 17 or newer" libllvm19
    apt_update
    package=$(llvm_package) || stop "this system's package lists offer no libLLVM from 17 on" \
        "Install one by hand and name it in DRJIT_LIBLLVM_PATH, or use Debian 12, Ubuntu 24.04 or newer."
    install_system "libLLVM, which compiles the kernels" "$package"
    "$PYTHON" -c "$check" || stop "$package is installed but no sound libLLVM was found" "See: .venv/bin/mirelight doctor"
}

need_libatomic() {
    [ "$(uname -s)" = Linux ] || return 0
    "$PYTHON" -c 'import ctypes; ctypes.CDLL("libatomic.so.1")' 2>/dev/null || install_system "libatomic, which Dr.Jit needs" libatomic1
}

# --- Python ---

# The first Python that is new enough.
find_python() {
    local name
    for name in python3 python3.13 python3.12 python3.11; do
        command -v "$name" >/dev/null && "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' && { echo "$name"; return; }
    done
    return 1
}

make_venv() {
    local python version
    # A virtual environment whose Python is gone or too old is made anew.
    "$PYTHON" -c 'import sys, pip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && return
    python=$(find_python) || { install_system "Python 3.11 or newer" python3 && python=$(find_python); } ||
        stop "Python 3.11 or newer is needed, and $(python3 --version 2>&1) is what this system has"
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        install_system "Python's venv module" "python$version-venv"
    fi
    say "making the virtual environment .venv (Python $version)"
    "$python" -m venv --clear .venv
}

# Runs pip quietly, or stops with the end of what it said: pip_install WHAT ARGUMENT…
pip_install() {
    local what=$1; shift
    "$PYTHON" -m pip install --disable-pip-version-check "$@" >"$log" 2>&1 && return
    tail -n 5 "$log" >&2
    stop "pip could not install $what" "By hand: .venv/bin/pip install $*" "Then run this script again."
}

# Installs a locked environment and mirelight itself, once per content of the lock: install_locked LOCK
install_locked() {
    local lock=$1 stamp=.venv/mirelight-$1.sha256 wanted
    wanted=$(cat "$lock" pyproject.toml <(pwd) | sha256sum)
    [ "$(cat "$stamp" 2>/dev/null)" = "$wanted" ] && return
    say "installing the locked Python environment ($lock)"
    pip_install "$lock" --require-hashes -r "$lock"
    pip_install "mirelight itself" --no-deps --no-build-isolation --editable .
    printf '%s\n' "$wanted" >"$stamp"
}

# --- the real-time engine ---

# PlayCanvas (by npm) and Chromium, which `mirelight realtime` and its tests run.
need_engine() {
    local check="from mirelight.apps.realtime import engine, browser; browser.find_browser(); raise SystemExit(not engine.installed())"
    "$PYTHON" -c "$check" 2>/dev/null && return
    "$PYTHON" -c "from mirelight.apps.realtime import browser; browser.find_browser()" 2>/dev/null ||
        install_system "Chromium, which runs the real-time engine" chromium
    command -v npm >/dev/null || install_system "npm, which fetches the real-time engine" npm
    say "fetching the real-time engine"
    "$PYTHON" -c "from mirelight.apps.realtime import engine; engine.install()" >"$log" 2>&1 && return
    tail -n 1 "$log" >&2
    stop "the real-time engine could not be fetched" "By hand: npm pack playcanvas, see docs/guides/realtime.md"
}

# --- the trainer of captures ---

# A C++ compiler with OpenMP, for scripts/scenegen/train.cpp, which a test compiles.
need_compiler() {
    command -v g++ >/dev/null || install_system "g++, which compiles the trainer of captures" g++
}

# --- the whole ---

# From a bare machine to a working .venv: set_up LOCK
set_up() {
    log=$(mktemp)
    trap 'rm -f "$log"' EXIT
    make_venv
    install_locked "$1"
    need_libatomic
    need_llvm
}
